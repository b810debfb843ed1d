"""Where partitions come from, at opening and again when a worker is lost: cut out of a mesh here, or files.

A folder of partitions, which :func:`write_partitions` makes once and every worker reaches under the same path, holds
``partition-00000.npz`` and so on and ``boundary.npz``. What opens it reads the boundary only; nobody has all of it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.distributed.held import HeldPartition
from mesh_motion_server.distributed.split import MeshPartition, Split, mesh_digest
from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.mesh.cells import CELL_TYPES, CellBlock, CellTable
from mesh_motion_server.numerics.mesh.points import bounding_box

__all__ = ["BoundaryShare", "FileSource", "MeshSource", "PartitionSource", "ReadPartition", "write_partitions"]

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


class PartitionSource(Protocol):
    """A mesh in partitions.

    Attributes
    ----------
    name : str
        A digest of the mesh.
    nodes : (b,) int64 array
        Nodes of the mesh with a role, ascending.
    points : (b, d) array, mesh length unit
        Their reference coordinates.
    shares : sequence of BoundaryShare
        One a partition.
    """

    name: str
    nodes: Ints
    points: Floats
    shares: Sequence[BoundaryShare]

    def make(self, number: int) -> HeldPartition | ReadPartition:
        """A partition, or what reads it on a worker."""
        ...


class MeshSource:
    """Partitions that are cut out of a mesh in the memory of this process.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    cells : CellTable
    boundary : (b,) int64 array
        Nodes with a role.
    count : int
        Number of partitions.
    """

    def __init__(self, points: Floats, cells: CellTable, boundary: Ints, count: int) -> None:
        self._split = Split.build(points, cells, count)
        self.name = mesh_digest(points, cells)
        self.nodes = np.unique(boundary)
        self.points = points[self.nodes]
        self.shares = [self._share(self._split.nodes(number)) for number in range(count)]

    def make(self, number: int) -> HeldPartition:
        """Cut it out."""
        return HeldPartition(self._split.partition(number))

    def _share(self, nodes: Ints) -> BoundaryShare:
        rows = np.searchsorted(nodes, self.nodes)
        places = np.flatnonzero(nodes[np.minimum(rows, len(nodes) - 1)] == self.nodes)
        return BoundaryShare(rows[places], places, bounding_box(self._split.points[nodes]))


@dataclass(frozen=True)
class ReadPartition:
    """Reads a partition where it is called: on a worker."""

    path: str

    def __call__(self) -> HeldPartition:
        """The partition.

        Raises
        ------
        InvalidInput
            If the file is not there.
        """
        try:
            with np.load(self.path, allow_pickle=False) as stored:
                arrays: dict[str, Any] = dict(stored)
        except OSError as error:
            raise InvalidInput(
                f"{self.path}: the worker cannot read this partition: {error.strerror or error}",
                hint="put the folder where every worker reaches it under the same path",
            ) from error
        blocks = tuple(
            CellBlock(cell_type, arrays[f"cells_{name}"])
            for name, cell_type in CELL_TYPES.items()
            if f"cells_{name}" in arrays
        )
        plain = {name: arrays[name] for name in _ARRAYS}
        return HeldPartition(MeshPartition(number=int(arrays["number"]), cells=CellTable(blocks), **plain))


class FileSource:
    """Partitions in a folder.

    Parameters
    ----------
    folder : path

    Raises
    ------
    InvalidInput
        If :func:`write_partitions` has not made it.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder.resolve()
        try:
            with np.load(self._folder / _BOUNDARY, allow_pickle=False) as stored:
                self.nodes, self.points, boxes = stored["nodes"], stored["points"], stored["boxes"]
                rows, places, first = stored["rows"], stored["places"], stored["first"]
                self.name = str(json.loads(str(stored["about"]))["mesh"])
        except (OSError, KeyError, ValueError) as error:
            raise InvalidInput(
                f"{folder}: expected a folder of partitions: {error}", hint="make it with write_partitions"
            ) from error
        spans = list(zip(first[:-1], first[1:], boxes, strict=True))
        self.shares = [BoundaryShare(rows[a:b], places[a:b], box) for a, b, box in spans]

    def make(self, number: int) -> ReadPartition:
        """What reads it."""
        return ReadPartition(str(self._folder / _partition(number)))


def write_partitions(folder: Path, points: Floats, cells: CellTable, boundary: Ints, count: int) -> FileSource:
    """Write a mesh in ``count`` partitions to a folder, one at a time; arguments as for :class:`MeshSource`."""
    source = MeshSource(points, cells, boundary, count)
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(count):
        mesh = source.make(number).mesh
        arrays: dict[str, Any] = {f"cells_{block.type.name}": block.nodes for block in mesh.cells}
        arrays |= {name: getattr(mesh, name) for name in _ARRAYS}
        np.savez(folder / _partition(number), number=mesh.number, **arrays)
    np.savez(
        folder / _BOUNDARY,
        nodes=source.nodes,
        points=source.points,
        boxes=np.stack([share.box for share in source.shares]),
        rows=np.concatenate([share.rows for share in source.shares]),
        places=np.concatenate([share.places for share in source.shares]),
        first=np.cumsum([0, *(len(share.rows) for share in source.shares)]),
        about=json.dumps({"mesh": source.name}),
    )
    return FileSource(folder)


_BOUNDARY = "boundary.npz"


def _partition(number: int) -> str:
    return f"partition-{number:05d}.npz"
