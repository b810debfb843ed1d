"""A mesh in partitions: equal shares of its nodes along the Morton curve, and the cells that belong to them.

A partition *owns* nodes, each of which has one owner, and cells. A cell belongs to the owner of its first node on the
curve. Nodes of its cells that it does not own are its *halo*. It moves them too, since a value costs less than a
message.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.mesh.cells import CellBlock, CellTable
from mesh_motion_server.numerics.mesh.morton import morton_codes
from mesh_motion_server.numerics.quality.orientation import oriented

__all__ = ["MeshPartition", "Split", "mesh_digest"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class MeshPartition:
    """What one worker needs to move its nodes and judge its cells.

    Attributes
    ----------
    number : int
    nodes : (p,) int64 array
        Nodes of the mesh, ascending: its own and the halo.
    own : (o,) int64 array
        Rows of ``nodes`` that it owns.
    points : (p, d) array, mesh length unit
        Reference coordinates.
    cells : CellTable
        In rows of ``nodes``.
    cell_numbers : (m,) int64 array
        Their numbers in the mesh, ascending in each block.
    reference_sizes : (m,) array
    """

    number: int
    nodes: Ints
    own: Ints
    points: Floats
    cells: CellTable
    cell_numbers: Ints
    reference_sizes: Floats

    @property
    def nbytes(self) -> int:
        """Memory of its arrays."""
        arrays = (self.nodes, self.own, self.points, self.cell_numbers, self.reference_sizes)
        return sum(a.nbytes for a in arrays) + sum(block.nodes.nbytes for block in self.cells)


@dataclass(frozen=True, eq=False)
class Split:
    """The owner of each node and cell of a mesh; a partition is cut out when it is requested.

    Attributes
    ----------
    points : (n, d) array, mesh length unit
        Reference coordinates.
    cells : CellTable
    owner : (n,) int32 array
        Partition of each node.
    cell_owner : (m,) int32 array
    count : int
        Number of partitions.
    """

    points: Floats
    cells: CellTable
    owner: NDArray[np.int32]
    cell_owner: NDArray[np.int32]
    count: int

    @classmethod
    def build(cls, points: Floats, cells: CellTable, count: int) -> Split:
        """Split a mesh into ``count`` partitions, none of them without a cell.

        Raises
        ------
        InvalidInput
            If there are fewer cells or nodes than partitions, or so few that one partition has no cell.
        """
        rank = np.empty(len(points), dtype=np.int64)
        rank[np.argsort(morton_codes(points), kind="stable")] = np.arange(len(points))
        owner = (rank * count // len(points)).astype(np.int32)
        cell_owner = np.concatenate(
            [owner[np.take_along_axis(b.nodes, rank[b.nodes].argmin(axis=1)[:, None], axis=1)[:, 0]] for b in cells]
        )
        empty = np.flatnonzero(np.bincount(cell_owner, minlength=count) == 0)
        if len(empty):
            raise InvalidInput(
                f"a mesh of {len(points)} nodes and {len(cells)} cells in {count} partitions leaves partition "
                f"{empty[0]} without a cell",
                hint="take fewer partitions",
            )
        return cls(points, cells, owner, cell_owner, count)

    def own(self, number: int) -> Ints:
        """Return the nodes that a partition owns, ascending."""
        return np.flatnonzero(self.owner == number)

    def nodes(self, number: int) -> Ints:
        """Return its own nodes and its halo, ascending."""
        marked = self.owner == number
        for block, rows, _ in self._cells_of(number):
            marked[block.nodes[rows]] = True
        return np.flatnonzero(marked)

    def partition(self, number: int) -> MeshPartition:
        """Cut one partition out."""
        nodes, chosen = self.nodes(number), self._cells_of(number)
        points = np.ascontiguousarray(self.points[nodes])
        listed = CellTable(tuple(CellBlock(b.type, np.searchsorted(nodes, b.nodes[rows])) for b, rows, _ in chosen))
        cells, sizes, _ = oriented(points, listed)
        return MeshPartition(
            number=number,
            nodes=nodes,
            own=np.searchsorted(nodes, self.own(number)),
            points=points,
            cells=cells,
            cell_numbers=np.concatenate([first + rows for _, rows, first in chosen]),
            reference_sizes=sizes,
        )

    def _cells_of(self, number: int) -> list[tuple[CellBlock, Ints, int]]:
        """Return blocks with cells of a partition, the rows of these cells, and the number of a block's first cell."""
        found = []
        for block, first in zip(self.cells, self.cells.offsets, strict=False):
            rows = np.flatnonzero(self.cell_owner[first : first + len(block)] == number)
            if len(rows):
                found.append((block, rows, first))
        return found


def mesh_digest(points: Floats, cells: CellTable) -> str:
    """Return 32 hexadecimal digits that identify a mesh."""
    digest = hashlib.blake2b(repr(points.shape).encode(), digest_size=16)
    digest.update(np.ascontiguousarray(points).data)
    for block in cells:
        digest.update(f"{block.type.name} {len(block)}".encode())
        digest.update(np.ascontiguousarray(block.nodes).data)
    return digest.hexdigest()
