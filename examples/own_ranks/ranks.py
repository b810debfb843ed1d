"""A solver on several ranks moves its own nodes and computes their quality; the server has the boundary only.

``python ranks.py`` starts a server and two processes. ``mpiexec -n 4 python ranks.py tcp://HOST:7440`` takes the ranks
of mpi4py instead, and a running server.
"""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from mesh_motion_client import Credentials, Mesh, Patch, Session, connect

#: Cells along each side of a cube; those in its middle, the body, are left out.
COUNT, BODY = 24, (10, 14)
STEPS = 5


def own_part(rank: int, ranks: int) -> Mesh:
    """Every rank makes its own slab of the cube: hexahedra, their nodes with the numbers of the whole mesh."""
    x, y, z = np.meshgrid(*[np.arange(COUNT)] * 3, indexing="ij")
    low, high = (round(COUNT * part / ranks) for part in (rank, rank + 1))
    inside = np.all([(BODY[0] <= a) & (a < BODY[1]) for a in (x, y, z)], axis=0)
    own = (low <= x) & (x < high) & ~inside
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    place = np.stack([np.stack([x[own] + a, y[own] + b, z[own] + c], axis=-1) for a, b, c in corners], axis=1)
    numbers = place @ [(COUNT + 1) ** 2, COUNT + 1, 1]
    ids, cells = np.unique(numbers, return_inverse=True)
    at = np.stack(np.unravel_index(ids, [COUNT + 1] * 3), axis=-1)
    wall = np.flatnonzero(((at == 0) | (at == COUNT)).any(axis=1))
    body = np.flatnonzero(((BODY[0] <= at) & (at <= BODY[1])).all(axis=1))
    patches = {"body": Patch("moving", body), "wall": Patch("fixed", wall)}
    return Mesh(at / COUNT, {"hexahedron": cells.reshape(numbers.shape)}, patches, ids)


def motion(points: np.ndarray, step: int) -> np.ndarray:
    """The body swims and bends: total displacement after a step, a smooth function of a node's original position."""
    return 0.04 * step * np.stack([np.sin(3.0 * points[:, 1]), points[:, 0] - 0.5, np.cos(3.0 * points[:, 0])], axis=1)


def solve(session: Session, mesh: Mesh, report: Callable[[str], object]) -> np.ndarray:
    """Move and commit, as a solver does between its own steps."""
    for step in range(1, STEPS + 1):
        moved = session.move(motion(mesh.points[session.moving_nodes], step))
        committed = session.commit()
        quality = moved.quality["corrected"]
        line = f"step {step}: {quality['cells']} cells, minimum {quality['metric']['min']:.3f}"
        report(f"{line}, {moved.correction['freed_nodes']} nodes freed, digest {committed.digest.hex()[:8]}")
    return session.points()


def run(endpoint: str, rank: int, ranks: int, share: Callable[[Any], Any]) -> np.ndarray:
    """One rank: the first opens the session, and shares its credentials; the others join it."""
    mesh = own_part(rank, ranks)
    with connect(endpoint) as server:
        if rank == 0:
            shared = lambda credentials: share((credentials.session, credentials.token))  # noqa: E731
            session = server.open(mesh, partitions=ranks, evaluation="client", announce=shared)
        else:
            session = server.join(Credentials(*share(None)), mesh, partition=rank)
        with session:
            return solve(session, mesh, print if rank == 0 else lambda line: line)


def child(endpoint: str, credentials: Any) -> None:
    """The second process, without MPI."""
    run(endpoint, 1, 2, lambda _: credentials.recv())


def main(endpoint: str | None) -> None:
    """The ranks of mpi4py, or two processes and their own server."""
    if endpoint is not None:
        from mpi4py import MPI  # noqa: PLC0415  # only here

        comm = MPI.COMM_WORLD
        run(endpoint, comm.rank, comm.size, comm.bcast)
        return
    with connect() as server:
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe()
        second = context.Process(target=child, args=(server.endpoint, there))
        second.start()
        run(server.endpoint, 0, 2, here.send)
        second.join()


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
