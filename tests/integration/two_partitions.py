"""One mesh moved by two ranks over the wire, as it comes back together."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import mesh_motion_client as client
import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.numerics.mesh.roles import Patch

__all__ = ["moved_in_two_parts"]

Floats = NDArray[np.float64]
Mesh = tuple[Floats, CellTable, Mapping[str, Patch]]


def moved_in_two_parts(
    mesh: Mesh, settings: Mapping[str, Any], displacement: Callable[[NDArray[np.int64]], Floats]
) -> Floats:
    """(n, d) committed points of a mesh of one cell type, a rank for each half of the cells.

    Parameters
    ----------
    mesh : tuple of points (n, d), CellTable and patches
    settings : dict
    displacement : callable
        That of the moving nodes with the given numbers (k,) in the whole mesh, (k, d).
    """
    low = np.arange(len(mesh[1])) < len(mesh[1]) // 2
    parts = [_part(mesh, low), _part(mesh, ~low)]

    def drive(rank: int, session: client.Session) -> Floats:
        with session:
            session.move(displacement(parts[rank].global_ids[session.moving_nodes]))
            session.commit()
            return np.asarray(session.points())

    with client.connect() as server, client.connect(server.endpoint) as second, ThreadPoolExecutor(2) as pool:
        joined = []

        def announce(credentials: Any) -> None:
            joined.append(pool.submit(lambda: drive(1, second.join(credentials, parts[1], partition=1))))

        first = drive(0, server.open(parts[0], settings, partitions=2, announce=announce))
        pieces = [first, joined[0].result(60)]
    found = np.empty_like(mesh[0])
    for part, piece in zip(parts, pieces, strict=True):
        found[part.global_ids] = piece
    return found


def _part(mesh: Mesh, chosen: NDArray[np.bool_]) -> client.Mesh:
    """The chosen cells with their nodes, numbered locally, and the patches that they have nodes of."""
    points, cells, patches = mesh
    (block,) = cells
    ids = np.unique(block.nodes[chosen])
    local = np.full(len(points), -1)
    local[ids] = np.arange(len(ids))
    own = {name: client.Patch(p.role, local[np.intersect1d(p.nodes, ids)]) for name, p in patches.items()}
    own = {name: patch for name, patch in own.items() if len(patch.nodes)}
    return client.Mesh(points[ids], {block.type.name: local[block.nodes[chosen]]}, own, global_ids=ids)
