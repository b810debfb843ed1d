"""A mesh in partitions on disk, which workers read themselves.

A folder of partitions, which :func:`write_partitions` makes once and every worker reaches under the same path, holds
``partition-00000.npz`` and so on and ``boundary.npz``. The process that opens it reads the boundary only.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.distributed.held import HeldPartition
from mesh_motion_server.distributed.split import MeshPartition, Split, mesh_digest
from mesh_motion_server.numerics.mesh.cells import CELL_TYPES, CellBlock, CellTable
from mesh_motion_server.numerics.mesh.points import bounding_box

__all__ = ["BoundaryShare", "FileSource", "ReadPartition", "write_partitions"]

_ARRAYS = ("nodes", "own", "points", "cell_numbers", "reference_sizes")

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class BoundaryShare:
    """What a partition has of the boundary.

    Attributes
    ----------
    rows : (k,) int64 array
        Rows of the partition that are boundary nodes.
    places : (k,) int64 array
        Which boundary nodes they are.
    box : (2, d) array, mesh length unit
        Of all nodes of the partition in the reference mesh.
    """

    rows: Ints
    places: Ints
    box: Floats


@dataclass(frozen=True)
class ReadPartition:
    """Reads a partition where it is called: on a worker."""

    path: str

    def __call__(self) -> HeldPartition:
        """The partition."""
        with np.load(self.path, allow_pickle=False) as stored:
            arrays: dict[str, Any] = dict(stored)
        blocks = tuple(
            CellBlock(cell_type, arrays[f"cells_{name}"])
            for name, cell_type in CELL_TYPES.items()
            if f"cells_{name}" in arrays
        )
        plain = {name: arrays[name] for name in _ARRAYS}
        return HeldPartition(MeshPartition(number=int(arrays["number"]), cells=CellTable(blocks), **plain))


class FileSource:
    """Partitions in a folder that :func:`write_partitions` has made.

    Attributes
    ----------
    name : str
        A digest of the mesh.
    nodes : (b,) int64 array
        Nodes of the mesh with a role, ascending.
    points : (b, d) array, mesh length unit
        Their reference coordinates.
    shares : list of BoundaryShare
        One a partition.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder.resolve()
        with np.load(self._folder / _BOUNDARY, allow_pickle=False) as stored:
            self.nodes, self.points, boxes = stored["nodes"], stored["points"], stored["boxes"]
            rows, places, first = stored["rows"], stored["places"], stored["first"]
            self.name = str(stored["name"])
        spans = zip(first[:-1], first[1:], boxes, strict=True)
        self.shares = [BoundaryShare(rows[a:b], places[a:b], box) for a, b, box in spans]

    def make(self, number: int) -> ReadPartition:
        """What reads it."""
        return ReadPartition(str(self._folder / _partition(number)))


def write_partitions(folder: Path, points: Floats, cells: CellTable, boundary: Ints, count: int) -> FileSource:
    """Write a mesh with boundary nodes (b,) in ``count`` partitions to a folder, one at a time."""
    split, held = Split.build(points, cells, count), np.unique(boundary)
    folder.mkdir(parents=True, exist_ok=True)
    shares = []
    for number in range(count):
        mesh = split.partition(number)
        arrays: dict[str, Any] = {f"cells_{block.type.name}": block.nodes for block in mesh.cells}
        arrays |= {name: getattr(mesh, name) for name in _ARRAYS}
        np.savez(folder / _partition(number), number=mesh.number, **arrays)
        _, rows, places = np.intersect1d(mesh.nodes, held, assume_unique=True, return_indices=True)
        shares.append(BoundaryShare(rows, places, bounding_box(mesh.points)))
    np.savez(
        folder / _BOUNDARY,
        nodes=held,
        points=points[held],
        boxes=np.stack([share.box for share in shares]),
        rows=np.concatenate([share.rows for share in shares]),
        places=np.concatenate([share.places for share in shares]),
        first=np.cumsum([0, *(len(share.rows) for share in shares)]),
        name=mesh_digest(points, cells),
    )
    return FileSource(folder)


_BOUNDARY = "boundary.npz"


def _partition(number: int) -> str:
    return f"partition-{number:05d}.npz"
