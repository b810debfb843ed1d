"""Cell types and cell tables: the nodes of each corner simplex of each cell (thesis §2.3, Table 2.4).

Every quality metric and predictor works on *corner simplices*: a corner k of a cell with the nodes (k, a, b[, c]) has
the Jacobian ``A_k`` whose columns are the edges ``x_a - x_k, x_b - x_k[, x_c - x_k]``; ``det A_k > 0`` in a valid
cell. A simplex needs one corner, since all of its corners have the same determinant. In the thesis the Jacobian is
(3.5); for a triangle (3.15)–(3.17), a quad (3.23), a tetrahedron (3.25), a hexahedron (3.29), for which Table 2.4 is
correct.

Node order is VTK's, except that a wedge's corners are listed so that the *volume* is positive for the order of Gmsh,
SU2 and CGNS (first triangle seen anticlockwise from the second one).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate

import numpy as np
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats, Integers, Marks, Shorts

_SQRT3 = 3.0**0.5


@dataclass(frozen=True)
class CellType:
    """One kind of cell."""

    name: str  # as in the mesh file's ``cells_<name>`` and on the wire
    dimension: int  # 1, 2 or 3
    n_nodes: int
    #: tuple of (dimension + 1)-tuples. Local node numbers (k, a, b[, c]) of each corner simplex, positively oriented in
    #: a valid cell.
    corners: tuple[tuple[int, ...], ...]
    #: (dimension, dimension) matrix W: the Jacobian of every corner of the ideal cell, up to scale and rotation.
    ideal: tuple[tuple[float, ...], ...]
    #: The cell's length, area or volume is ``size_factor * sum_k det A_k`` (exact for parallelepipeds).
    size_factor: float
    vtk: int  # VTK's number of the cell type

    @property
    def is_simplex(self) -> bool:
        """Whether one Jacobian determines the cell's shape."""
        return self.n_nodes == self.dimension + 1

    @property
    def is_box(self) -> bool:
        """Whether the cell is a quad or a hexahedron."""
        return not self.is_simplex and len(self.corners) == 2**self.dimension

    @cached_property
    def corner_array(self) -> Integers:
        """(n_corners, dimension + 1) local node numbers."""
        return np.array(self.corners, dtype=np.int64)

    @cached_property
    def ideal_array(self) -> Floats:
        """(dimension, dimension) matrix W."""
        return np.array(self.ideal, dtype=np.float64)


_CUBE = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

CELL_TYPES: dict[str, CellType] = {
    t.name: t
    for t in (
        CellType("line", 1, 2, ((0, 1),), ((1.0,),), 1.0, 3),
        CellType("triangle", 2, 3, ((0, 1, 2),), ((1.0, 0.5), (0.0, _SQRT3 / 2)), 1 / 2, 5),
        CellType("quad", 2, 4, ((0, 1, 3), (1, 2, 0), (2, 3, 1), (3, 0, 2)), ((1.0, 0.0), (0.0, 1.0)), 1 / 4, 9),
        CellType(
            "tetra",
            3,
            4,
            ((0, 1, 2, 3),),
            ((1.0, 0.5, 0.5), (0.0, _SQRT3 / 2, _SQRT3 / 6), (0.0, 0.0, (2 / 3) ** 0.5)),
            1 / 6,
            10,
        ),
        # thesis Table 2.4 (k, a, b, c)
        CellType(
            "hexahedron",
            3,
            8,
            (
                (0, 1, 3, 4),
                (1, 2, 0, 5),
                (2, 3, 1, 6),
                (3, 0, 2, 7),
                (4, 7, 5, 0),
                (5, 4, 6, 1),
                (6, 5, 7, 2),
                (7, 6, 4, 3),
            ),
            _CUBE,
            1 / 8,
            12,
        ),
        # at each corner: the two edges of the triangle, then the edge between the triangles
        CellType(
            "wedge",
            3,
            6,
            ((0, 1, 2, 3), (1, 2, 0, 4), (2, 0, 1, 5), (3, 5, 4, 0), (4, 3, 5, 1), (5, 4, 3, 2)),
            ((1.0, 0.5, 0.0), (0.0, _SQRT3 / 2, 0.0), (0.0, 0.0, 1.0)),
            1 / 12,
            13,
        ),
        # the four corners of the base; the third edge goes to the apex; ideal: all eight edges equal
        CellType(
            "pyramid",
            3,
            5,
            ((0, 1, 3, 4), (1, 2, 0, 4), (2, 3, 1, 4), (3, 0, 2, 4)),
            ((1.0, 0.0, 0.5), (0.0, 1.0, 0.5), (0.0, 0.0, 0.5**0.5)),
            1 / 12,
            14,
        ),
    )
}


@dataclass(frozen=True, eq=False)
class CellBlock:
    """Cells of one type."""

    type: CellType
    #: (m, n_nodes) int32. Node indices, 0-based; 32 bits, because every judgement of a mesh reads all of them.
    nodes: Shorts

    def __len__(self) -> int:
        return len(self.nodes)

    @property
    def corner_nodes(self) -> Shorts:
        """(c, d + 1) nodes of the corner simplices, cell by cell, contiguous; for simplices these are the cells."""
        if self.type.is_simplex:
            return np.ascontiguousarray(self.nodes)
        return np.ascontiguousarray(self.nodes[:, self.type.corner_array].reshape(-1, self.type.dimension + 1))


def _short(name: str, nodes: NDArray[np.integer]) -> Shorts:
    """Cells (m, n_nodes) of a type as 32-bit numbers."""
    if not np.can_cast(nodes.dtype, np.int32):
        most = np.iinfo(np.int32).max
        if nodes.max() > most or nodes.min() < -most:
            row, place = (int(i) for i in np.argwhere((nodes > most) | (nodes < -most))[0])
            index = int(nodes[row, place])
            raise InvalidInput(
                f"cells of type {name!r}, row {row}: node index {index} is out of range, expected 0 to {most}",
                code="INVALID_ARGUMENT.MESH_DEGENERATE",
                details={"type": name, "row": row, "index": index},
            )
    return np.ascontiguousarray(nodes, dtype=np.int32)


@dataclass(frozen=True, eq=False)
class CellTable:
    """All cells of a mesh: blocks in the order of :data:`CELL_TYPES`; cell numbers run through the blocks."""

    blocks: tuple[CellBlock, ...]  # Non-empty, all of one dimension

    @classmethod
    def from_arrays(cls, cells: Mapping[str, NDArray[np.integer]]) -> CellTable:
        """Build from ``{type name: (m, n_nodes) integer array}``; empty arrays are left out.

        Raises InvalidInput on an unknown type name, a wrong shape, mixed dimensions, an index beyond 32 bits, or no
        cell at all.
        """
        for name, nodes in cells.items():
            if name not in CELL_TYPES:
                raise InvalidInput(f"unknown cell type {name!r}; known are {', '.join(CELL_TYPES)}")
            expected = CELL_TYPES[name].n_nodes
            if np.ndim(nodes) != 2 or np.shape(nodes)[1] != expected:
                raise InvalidInput(
                    f"cells of type {name!r}: expected an array of shape (m, {expected}), got {np.shape(nodes)}",
                    code="INVALID_ARGUMENT.SHAPE",
                )
        blocks = tuple(
            CellBlock(cell_type, _short(name, np.asarray(cells[name])))
            for name, cell_type in CELL_TYPES.items()
            if name in cells and len(cells[name])
        )
        if not blocks:
            raise InvalidInput(
                "the mesh has no cells", code="INVALID_ARGUMENT.MESH", hint="send at least one cell of a known type"
            )
        if len({block.type.dimension for block in blocks}) > 1:
            names = ", ".join(f"{b.type.name} ({b.type.dimension}D)" for b in blocks)
            raise InvalidInput(f"cells of different dimension in one mesh: {names}", code="INVALID_ARGUMENT.MESH")
        return cls(blocks)

    def __len__(self) -> int:
        return self.offsets[-1]

    def __iter__(self) -> Iterator[CellBlock]:
        return iter(self.blocks)

    @cached_property
    def dimension(self) -> int:
        """1, 2 or 3."""
        return self.blocks[0].type.dimension

    @cached_property
    def offsets(self) -> tuple[int, ...]:
        """Number of the first cell of each block, and the number of cells at the end."""
        return tuple(accumulate(map(len, self.blocks), initial=0))

    @cached_property
    def nodes(self) -> tuple[Shorts, ...]:
        """Nodes (m, n_nodes) of each block, contiguous, as the compiled loops take them."""
        return tuple(np.ascontiguousarray(block.nodes) for block in self.blocks)

    @cached_property
    def corner_nodes(self) -> Shorts:
        """(c, d + 1) nodes of the corner simplices, cell by cell."""
        corners = [block.corner_nodes for block in self]
        return corners[0] if len(corners) == 1 else np.concatenate(corners)

    def chosen(self, marked: Marks, renumbered: Shorts | None = None) -> CellTable:
        """The marked (m,) cells, at least one; if given, with the ``renumbered`` (n,) number of each node."""
        blocks = []
        for block, span in self.numbered:
            nodes = block.nodes[marked[span]]
            if len(nodes):
                blocks.append(CellBlock(block.type, nodes if renumbered is None else renumbered[nodes]))
        return CellTable(tuple(blocks))

    def within(self, nodes: Marks) -> Marks:
        """(m,) whether all nodes of each cell are among the marked (n,) ``nodes``."""
        return np.concatenate([nodes[block.nodes].all(axis=1) for block in self])

    @property
    def corner_shares(self) -> Floats:
        """(c,) for each corner simplex, one over the number of its cell's corner simplices."""
        counts = np.repeat([len(block.type.corners) for block in self.blocks], np.diff(self.offsets))
        return np.repeat(1.0 / counts, counts)

    @cached_property
    def numbered(self) -> tuple[tuple[CellBlock, slice], ...]:
        """Each block with the slice of cell numbers that belongs to it."""
        return tuple(zip(self.blocks, map(slice, self.offsets, self.offsets[1:]), strict=True))

    def located(self, numbers: NDArray[np.integer]) -> Iterator[tuple[CellBlock, Marks, Integers]]:
        """Each block, which of the cells with these numbers (s,) are in it, and their rows there."""
        for block, span in self.numbered:
            here = (numbers >= span.start) & (numbers < span.stop)
            yield block, here, numbers[here] - span.start

    def locate(self, cell: int) -> tuple[CellBlock, int]:
        """The block of a cell number, and the row in it."""
        for block, span in self.numbered:
            if cell < span.stop:
                return block, cell - span.start
        raise IndexError(cell)

    def centres(self, points: NDArray[np.floating], numbers: NDArray[np.integer]) -> Floats:
        """(s, d) mean of the nodes of each of the cells with these numbers (s,), from positions (n, d)."""
        out = np.empty((len(numbers), points.shape[1]))
        for block, here, rows in self.located(numbers):
            out[here] = points[block.nodes[rows]].mean(axis=1)
        return out
