"""A mesh cut into partitions: equal shares of its nodes along the Morton curve, and the cells that begin there.

A cell belongs to the share of its first node on the curve. A partition has its cells and all their nodes: a node
between two partitions is in both, with one number in the whole mesh.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Integers
from mesh_motion_numerics.mesh.morton import morton_codes
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.mesh_file import MeshFile
from mesh_motion_server.files.writer import write_mesh


def partitions(mesh: MeshFile, count: int) -> Iterator[MeshFile]:
    """Cut a mesh into ``count`` partitions, which are made one after the other.

    Nodes are ascending by number in the mesh, cells are in its order. A patch has those of its nodes that are in the
    partition; it is left out if there are none. Nodes that belong to no cell are left out. Raises InvalidInput if there
    are fewer cells or nodes than partitions, or so few that one partition has no cell.
    """
    if count < 1:
        raise InvalidInput(f"{mesh.path}: expected one partition or more, got {count}")
    place = np.empty(len(mesh.points), dtype=np.int64)
    place[np.argsort(morton_codes(mesh.points), kind="stable")] = np.arange(len(mesh.points))
    share = place * count // len(place)
    owners = {name: share[_first_on_curve(nodes, place)] for name, nodes in mesh.cells.items()}
    filled = np.bincount(np.concatenate(list(owners.values())), minlength=count) > 0
    if not filled.all():
        raise InvalidInput(
            f"{mesh.path}: a mesh of {len(mesh.points)} nodes and {mesh.n_cells} cells in {count} partitions leaves "
            f"partition {int(np.argmin(filled))} without a cell",
            hint="take fewer partitions",
        )
    for number in range(count):
        cells = {name: mesh.cells[name][owner == number] for name, owner in owners.items()}
        yield _partition(mesh, {name: nodes for name, nodes in cells.items() if len(nodes)})


def write_partitions(folder: Path, mesh: MeshFile, count: int) -> list[Path]:
    """Write the partitions of a mesh to ``partition-000.npz`` and so on in a folder, which is made; return the files.

    Raises InvalidInput, ResourceExhausted as :func:`partitions` and :func:`.writer.write_mesh` do.
    """
    written = []
    for number, part in enumerate(partitions(mesh, count)):
        folder.mkdir(parents=True, exist_ok=True)
        written.append(folder / f"partition-{number:03d}.npz")
        write_mesh(written[-1], part)
    return written


def _first_on_curve(nodes: Integers, place: Integers) -> Integers:
    """(m,) for each cell (m, k) its first node on the curve."""
    first: Integers = np.take_along_axis(nodes, place[nodes].argmin(axis=1)[:, None], axis=1)[:, 0]
    return first


def _partition(mesh: MeshFile, cells: dict[str, Integers]) -> MeshFile:
    """The part of a mesh with the given cells and their nodes."""
    held = np.zeros(len(mesh.points), dtype=np.bool_)
    for nodes in cells.values():
        held[nodes] = True
    ids = np.flatnonzero(held)
    local = np.cumsum(held) - 1
    patches = {name: local[nodes[held[nodes]]] for name, nodes in mesh.patches.items()}
    return replace(
        mesh,
        points=mesh.points[ids],
        cells={name: local[nodes] for name, nodes in cells.items()},
        patches={name: nodes for name, nodes in patches.items() if len(nodes)},
        global_ids=ids if mesh.global_ids is None else mesh.global_ids[ids],
        notes=(),
    )
