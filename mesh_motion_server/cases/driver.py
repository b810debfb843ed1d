"""Opens the session that :mod:`.play` drives a case through, or resumes the one that an earlier run has kept."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Literal

from mesh_motion_client import Credentials, Keys, Mesh, MeshMotionError, Patch, Session, connect

from mesh_motion_server.cases.case import Case
from mesh_motion_server.cases.kept import Kept
from mesh_motion_server.files import MeshFile

__all__ = ["open_session"]


@contextmanager
def open_session(
    case: Case,
    mesh: MeshFile,
    endpoint: str | None,
    kept: Kept,
    *,
    resumed: bool = False,
    server_options: Sequence[str] = (),
    keys: Keys | None = None,
) -> Iterator[Session]:
    """Open a session for a case, or resume the kept one (``resumed``); discard it when the block ends without an error.

    Parameters
    ----------
    endpoint : str or None
        None: a private server that ends with the session.
    kept : Kept
        Folder where a private server stores the session, and the credentials to resume it.
    server_options : sequence of str
        Options of ``mesh-motion serve`` for a private server.
    keys : Keys, optional
        Keys for a server that requires them.
    """
    patches = {name: Patch(role, mesh.patches[name]) for name, role in case.content.patches.items()}
    asked = {"roles": dict(case.content.patches), "method": case.content.method.model_dump(exclude_unset=True)}
    settings = kept.settings(asked) if resumed else {}
    state = kept.state if endpoint is None else None
    with connect(endpoint, state=state, server_options=server_options, keys=keys) as server:
        if resumed:
            session = server.resume(Credentials.load(kept.credentials))
            session.settings = settings  # a resumed session does not know them
        else:
            session = server.open(Mesh(mesh.points, mesh.cells, patches), asked["method"], label=case.name)
            session.credentials.save(kept.credentials)
            kept.begin(asked, session.settings)
        outcome: Literal["keep", "discard"] = "keep"
        try:
            yield session
            outcome = "discard"
        finally:
            with suppress(MeshMotionError):  # the results do not depend on it
                session.close(outcome if session.step else "discard")
