"""Opens the sessions for a case and for the replay of a recorded session."""

import warnings
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from typing import Any

from mesh_motion_client import Keys, Mesh, MeshMotionError, MeshMotionWarning, Patch, Session, connect

from mesh_motion_server.cases.case import Case
from mesh_motion_server.files import MeshFile


def open_session(
    case: Case, mesh: MeshFile, endpoint: str | None, *, keys: Keys | None = None
) -> AbstractContextManager[Session]:
    """Open a session for a case, as :func:`passing_session` does."""
    patches = {name: Patch(role, mesh.patches[name]) for name, role in case.roles.items()}
    method = case.content.method.model_dump(exclude_unset=True)
    return passing_session(Mesh(mesh.points, mesh.cells, patches), method, endpoint, keys, label=case.name)


@contextmanager
def passing_session(
    mesh: Mesh, settings: Mapping[str, Any], endpoint: str | None, keys: Keys | None, **options: Any
) -> Iterator[Session]:
    """Yield a session with these ``options`` of :meth:`.Server.open`; it is discarded when the block ends.

    Parameters
    ----------
    endpoint : str or None
        None: a private server that ends with the session.
    keys : Keys or None
        Keys for a server that requires them.
    """
    with warnings.catch_warnings(), connect(endpoint, keys=keys) as server:
        warnings.simplefilter("ignore", MeshMotionWarning)  # the results collect the warnings
        session = server.open(mesh, settings, **options)
        try:
            yield session
        finally:
            with suppress(MeshMotionError):  # the results do not depend on durability
                session.close("discard")
