"""A part of the mesh whose trial nodes are free: its nodes, the cells that feel them, and their adjacency.

Everything that the Newton iterations touch is numbered locally, free nodes first, so their cost follows the region and
not the mesh. Scatters from corners to nodes are gathers over fixed lists: no atomics, the same sums in the same order
whatever the number of threads.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.numerics.cell_distortion import CellGroup, cell_groups
from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.distortion import CornerSimplices, corner_simplices
from mesh_motion_server.numerics.metrics import AtRest
from mesh_motion_server.numerics.read_only import read_only

__all__ = ["CellAdjacency", "FreeRegion", "NodeAdjacency", "free_region", "grow", "nodes_of_cells"]

_DIAGONALS = np.array([[0, 6], [1, 7], [2, 4], [3, 5]])  # of a hexahedron
_ROWS = 64  # nodes per block of the compiled gathers


@dataclass(frozen=True, eq=False)
class NodeAdjacency:
    """Where the corners of each free node are, and the pattern of the Hessian: d × d blocks, diagonal first in a row.

    Attributes
    ----------
    starts : (f + 1) int64 array
        Free node i appears in the entries ``starts[i]:starts[i + 1]``.
    entries : (e) int32 array
        ``corner · (d + 1) + place``: in which corner, as which of its nodes.
    slots : (e, d + 1) int32 array
        Position, among the Hessian's blocks, of the coupling to each node of that corner; −1 for a held node.
    row_starts, columns : (f + 1) int64, (b) int32 arrays
        Block rows of the Hessian.
    """

    starts: NDArray[np.int64]
    entries: NDArray[np.int32]
    slots: NDArray[np.int32]
    row_starts: NDArray[np.int64]
    columns: NDArray[np.int32]

    def gather(self, corner_values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sum the corners' shares (c, d + 1, d) at the free nodes: (f, d)."""
        d = corner_values.shape[2]
        out = np.empty((len(self.starts) - 1, d))
        _gather(self.starts, self.entries, corner_values.reshape(-1, d), out)
        return out

    def assemble(self, blocks: NDArray[np.float32], d: int) -> NDArray[np.float64]:
        """Hessian blocks (b, d, d) from the corners' blocks (c, d², d²), see :mod:`.curvature`."""
        hessian = np.empty((len(self.columns), d, d))
        self.reassemble(blocks, np.ones(len(blocks), dtype=np.bool_), hessian)
        return hessian

    def reassemble(self, blocks: NDArray[np.float32], changed: NDArray[np.bool_], hessian: NDArray[np.float64]) -> None:
        """Bring the Hessian (b, d, d) up to date after some (c,) of the corners' blocks have changed."""
        _assemble(self.starts, self.entries, self.slots, self.row_starts, blocks, changed, hessian)


@dataclass(frozen=True, eq=False)
class CellAdjacency:
    """Where the cells of one type are, in the same pattern of the Hessian.

    Attributes
    ----------
    starts : (f + 1) int64 array
    entries : (e) int32 array
        ``cell · k + place``.
    slots : (e, k) int32 array
    """

    starts: NDArray[np.int64]
    entries: NDArray[np.int32]
    slots: NDArray[np.int32]

    def gather(self, cell_values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sum the cells' shares (m, k, d) at the free nodes: (f, d)."""
        d = cell_values.shape[2]
        out = np.empty((len(self.starts) - 1, d))
        _gather(self.starts, self.entries, cell_values.reshape(-1, d), out)
        return out

    def add(self, blocks: NDArray[np.float32], hessian: NDArray[np.float64]) -> None:
        """Add the cells' blocks (m, k d, k d) to the Hessian (b, d, d)."""
        _add_cells(self.starts, self.entries, self.slots, blocks, hessian)


@dataclass(frozen=True, eq=False)
class FreeRegion:
    """Free nodes and the cells that touch them.

    Attributes
    ----------
    nodes : (l) int64 array
        Global numbers of the local nodes: the free ones first, then the other nodes of their cells.
    n_free : int
    cell_numbers : (k) int64 array
        Global numbers of the cells.
    cells : CellTable
        The same cells in local node numbers.
    reference_sizes : (k) array, length^d, or CellsAtRest
    simplices : CornerSimplices
        Their corners, in local node numbers.
    adjacency : NodeAdjacency
    """

    nodes: NDArray[np.int64]
    n_free: int
    cell_numbers: NDArray[np.int64]
    cells: CellTable
    reference_sizes: AtRest
    simplices: CornerSimplices
    adjacency: NodeAdjacency

    @cached_property
    def groups(self) -> tuple[CellGroup, ...]:
        """The cells by type."""
        return cell_groups(self.cells, self.reference_sizes, self.simplices)

    @cached_property
    def cell_adjacency(self) -> tuple[CellAdjacency, ...]:
        """Of each group."""
        pattern = self.adjacency.row_starts, self.adjacency.columns
        return tuple(
            CellAdjacency(*_cell_adjacency(group.nodes, self.n_free, len(self.nodes), *pattern))
            for group in self.groups
        )

    @property
    def free(self) -> NDArray[np.int64]:
        """Global numbers of the free nodes."""
        return self.nodes[: self.n_free]


def nodes_of_cells(cells: CellTable, chosen: NDArray[np.bool_], n_nodes: int) -> NDArray[np.bool_]:
    """Mark (n) the nodes of the chosen (m) cells."""
    marked = np.zeros(n_nodes, dtype=bool)
    for block, first in zip(cells, cells.offsets, strict=False):
        marked[block.nodes[chosen[first : first + len(block)]]] = True
    return marked


def cells_of_nodes(cells: CellTable, marked: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mark (m) the cells that have a marked (n) node."""
    return np.concatenate([_touch(read_only(block.nodes), read_only(marked)) for block in cells])


def grow(cells: CellTable, marked: NDArray[np.bool_], rings: int) -> NDArray[np.bool_]:
    """Marked nodes (n) and their neighbours through ``rings`` layers of cells."""
    for _ in range(rings):
        marked = nodes_of_cells(cells, cells_of_nodes(cells, marked), len(marked))
    return marked


def free_region(
    reference: NDArray[np.float64],
    cells: CellTable,
    reference_sizes: AtRest,
    free: NDArray[np.bool_],
    *,
    chosen: NDArray[np.bool_] | None = None,
) -> FreeRegion:
    """Cut the region of the free nodes out of the mesh.

    Parameters
    ----------
    reference : (n, d) array, mesh length unit
        Nodes of the reference mesh.
    cells : CellTable
    reference_sizes : (m,) array, length^d, or CellsAtRest
    free : (n,) bool array
        At least one node is free, and each belongs to a cell.
    chosen : (m,) bool array, optional
        Cells of the region; by default all that touch a free node.
    """
    chosen = cells_of_nodes(cells, free) if chosen is None else chosen
    marked = nodes_of_cells(cells, chosen, len(free))
    free = free & marked
    nodes = np.concatenate([np.flatnonzero(free), np.flatnonzero(marked & ~free)])
    n_free = int(np.count_nonzero(free))
    local = np.empty(len(free), dtype=np.int64)
    local[nodes] = np.arange(len(nodes))
    table = CellTable.from_arrays(
        {
            block.type.name: local[block.nodes[chosen[first : first + len(block)]]]
            for block, first in zip(cells, cells.offsets, strict=False)
        }
    )
    sizes = reference_sizes[chosen]
    simplices = corner_simplices(reference[nodes], table, sizes)
    adjacency = NodeAdjacency(*_adjacency(simplices.nodes, n_free, len(nodes), _diagonals(table)))
    return FreeRegion(nodes, n_free, np.flatnonzero(chosen), table, sizes, simplices, adjacency)


@njit(cache=True, error_model="numpy")
def _touch(cell_nodes, marked):  # type: ignore[no-untyped-def]
    """(m) bool: cells (m, k) with a marked node."""
    out = np.zeros(len(cell_nodes), np.bool_)
    for c in range(len(cell_nodes)):
        for k in range(cell_nodes.shape[1]):
            if marked[cell_nodes[c, k]]:
                out[c] = True
    return out


def _diagonals(cells: CellTable) -> NDArray[np.int64]:
    """(h, 2) pairs of nodes that share a cell but no corner simplex: the diagonals of hexahedra."""
    pairs = [block.nodes[:, _DIAGONALS].reshape(-1, 2) for block in cells if block.type.name == "hexahedron"]
    return np.concatenate([*pairs, np.empty((0, 2), dtype=np.int64)])


@njit(cache=True, error_model="numpy")
def _places(cell_nodes, n_free):  # type: ignore[no-untyped-def]
    """(starts, entries): the places of the free nodes in cells (m, k), by counting sort."""
    n, k = cell_nodes.shape
    starts = np.zeros(n_free + 1, np.int64)
    for c in range(n):
        for a in range(k):
            if cell_nodes[c, a] < n_free:
                starts[cell_nodes[c, a] + 1] += 1
    for i in range(n_free):
        starts[i + 1] += starts[i]
    entries = np.empty(starts[n_free], np.int32)
    place = starts[:-1].copy()
    for c in range(n):
        for a in range(k):
            i = cell_nodes[c, a]
            if i < n_free:
                entries[place[i]] = c * k + a
                place[i] += 1
    return starts, entries


@njit(cache=True, error_model="numpy")
def _adjacency(corners, n_free, n_nodes, diagonals):  # type: ignore[no-untyped-def]
    """The arrays of :class:`NodeAdjacency`: the places, then one pass per row with a table of columns."""
    k = corners.shape[1]
    starts, entries = _places(corners, n_free)
    ends, others = _places(diagonals, n_free)
    slots = np.full((len(entries), k), -1, np.int32)
    row_starts = np.zeros(n_free + 1, np.int64)
    columns = np.empty(len(entries) * (k - 1) + len(others) + n_free, np.int32)
    where = np.full(n_nodes, -1, np.int64)
    filled = 0
    for i in range(n_free):
        first = filled
        columns[filled] = i
        where[i] = filled
        filled += 1
        for e in range(starts[i], starts[i + 1]):
            c = entries[e] // k
            for b in range(k):
                j = corners[c, b]
                if j < n_free:
                    if where[j] < first:
                        where[j] = filled
                        columns[filled] = j
                        filled += 1
                    slots[e, b] = where[j]
        for e in range(ends[i], ends[i + 1]):
            j = diagonals[others[e] // 2, 1 - others[e] % 2]
            if j < n_free and where[j] < first:
                where[j] = filled
                columns[filled] = j
                filled += 1
        row_starts[i + 1] = filled
    return starts, entries, slots, row_starts, columns[:filled].copy()


@njit(cache=True, error_model="numpy")
def _cell_adjacency(cell_nodes, n_free, n_nodes, row_starts, columns):  # type: ignore[no-untyped-def]
    """The arrays of :class:`CellAdjacency` in a given pattern."""
    k = cell_nodes.shape[1]
    starts, entries = _places(cell_nodes, n_free)
    slots = np.full((len(entries), k), -1, np.int32)
    where = np.empty(n_nodes, np.int64)
    for i in range(n_free):
        for e in range(row_starts[i], row_starts[i + 1]):
            where[columns[e]] = e
        for e in range(starts[i], starts[i + 1]):
            for b in range(k):
                j = cell_nodes[entries[e] // k, b]
                if j < n_free:
                    slots[e, b] = where[j]
    return starts, entries, slots


@njit(cache=True, error_model="numpy", parallel=True)
def _add_cells(starts, entries, slots, blocks, out):  # type: ignore[no-untyped-def]
    """out (b, d, d) += the rows of the cells' blocks (m, k d, k d)."""
    n, d, k = len(starts) - 1, out.shape[1], slots.shape[1]
    for block in prange((n + _ROWS - 1) // _ROWS):
        for i in range(block * _ROWS, min(n, (block + 1) * _ROWS)):
            for e in range(starts[i], starts[i + 1]):
                whole, a = blocks[entries[e] // k], entries[e] % k
                for b in range(k):
                    if slots[e, b] >= 0:
                        for r in range(d):
                            for q in range(d):
                                out[slots[e, b], r, q] += whole[a * d + r, b * d + q]


@njit(cache=True, error_model="numpy", parallel=True)
def _gather(starts, entries, values, out):  # type: ignore[no-untyped-def]
    """out (f, d) = sum of the rows of values (c (d + 1), d) that belong to each node."""
    n, d = out.shape
    for block in prange((n + _ROWS - 1) // _ROWS):
        for i in range(block * _ROWS, min(n, (block + 1) * _ROWS)):
            for k in range(d):
                out[i, k] = 0.0
            for e in range(starts[i], starts[i + 1]):
                for k in range(d):
                    out[i, k] += values[entries[e], k]


@njit(cache=True, error_model="numpy", forceinline=True)
def _any_changed(entries, k, changed):  # type: ignore[no-untyped-def]
    """Whether any of a node's corners has changed."""
    for entry in entries:  # noqa: SIM110 compiled
        if changed[entry // k]:
            return True
    return False


@njit(cache=True, error_model="numpy", parallel=True)
def _assemble(starts, entries, slots, row_starts, blocks, changed, out):  # type: ignore[no-untyped-def]
    """out (b, d, d): rows of the Hessian, anew where a corner has changed."""
    n, d = len(starts) - 1, out.shape[1]
    for block in prange((n + _ROWS - 1) // _ROWS):
        row = np.empty((d, d * d))
        for i in range(block * _ROWS, min(n, (block + 1) * _ROWS)):
            if not _any_changed(entries[starts[i] : starts[i + 1]], d + 1, changed):
                continue
            out[row_starts[i] : row_starts[i + 1]] = 0.0
            for e in range(starts[i], starts[i + 1]):
                c, a = entries[e] // (d + 1), entries[e] % (d + 1)
                if d == 3:
                    _add_rows(blocks[c], a, slots[e], 3, row, out)
                elif d == 2:
                    _add_rows(blocks[c], a, slots[e], 2, row, out)
                else:
                    _add_rows(blocks[c], a, slots[e], 1, row, out)


@njit(cache=True, error_model="numpy", forceinline=True)
def _rows(corner_block, a, d, row):  # type: ignore[no-untyped-def]
    """row (d, d²) = the rows of a corner's node a: an edge's, or minus the sum of all for node 0."""
    for r in range(d):
        for q in range(d * d):
            if a > 0:
                row[r, q] = corner_block[(a - 1) * d + r, q]
            else:
                t = 0.0
                for j in range(d):
                    t -= corner_block[j * d + r, q]
                row[r, q] = t


@njit(cache=True, error_model="numpy", forceinline=True)
def _add_rows(corner_block, a, slots, d, row, out):  # type: ignore[no-untyped-def]
    """Add the rows of a corner's node a to the blocks of its slots; the column of node 0 is minus the sum of all."""
    _rows(corner_block, a, d, row)
    if slots[0] >= 0:
        for r in range(d):
            for q in range(d):
                t = 0.0
                for j in range(d):
                    t += row[r, j * d + q]
                out[slots[0], r, q] -= t
    for b in range(d):
        slot = slots[b + 1]
        if slot >= 0:
            for r in range(d):
                for q in range(d):
                    out[slot, r, q] += row[r, b * d + q]
