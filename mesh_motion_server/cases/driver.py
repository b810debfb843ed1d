"""Opens the session that :mod:`.play` drives a case through."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from mesh_motion_client import Keys, Mesh, MeshMotionError, MeshMotionWarning, Patch, Session, connect

from mesh_motion_server.cases.case import Case
from mesh_motion_server.files import MeshFile

__all__ = ["open_session"]


@contextmanager
def open_session(case: Case, mesh: MeshFile, endpoint: str | None, *, keys: Keys | None = None) -> Iterator[Session]:
    """Open a session for a case; it is discarded when the block ends.

    Parameters
    ----------
    endpoint : str or None
        None: a private server that ends with the session.
    keys : Keys, optional
        Keys for a server that requires them.
    """
    patches = {name: Patch(role, mesh.patches[name]) for name, role in case.content.patches.items()}
    method = case.content.method.model_dump(exclude_unset=True)
    with warnings.catch_warnings(), connect(endpoint, keys=keys) as server:
        warnings.simplefilter("ignore", MeshMotionWarning)  # the results collect them
        session = server.open(Mesh(mesh.points, mesh.cells, patches), method, label=case.name)
        try:
            yield session
        finally:
            with suppress(MeshMotionError):  # the results do not depend on it
                session.close("discard")
