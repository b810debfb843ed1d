"""A part of the mesh whose trial nodes are free: its nodes, the cells that depend on them, and their adjacency.

Everything that the Newton iterations use is numbered locally, free nodes first, so their cost depends on the region and
not on the mesh. The sums at nodes go over fixed lists of corners: no atomics, and the same sums in the same order for
any number of threads.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats, Integers, Marks, Shorts
from mesh_motion_numerics.correction.cell_distortion import CellGroup, cell_groups
from mesh_motion_numerics.correction.distortion import CornerSimplices, corner_simplices
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import AtRest, CellsAtRest

_DIAGONALS = np.array([[0, 6], [1, 7], [2, 4], [3, 5]])  # of a hexahedron
_LEAST_AGGREGATE = 64  # nodes
_AGGREGATES = {1: 800, 2: 800, 3: 200}  # at most, by dimension: their factorization takes a few per cent of a step


@dataclass(frozen=True, eq=False)
class NodeAdjacency:
    """The corners of each free node, and the pattern of the Hessian: d × d blocks, the diagonal first in each row.

    Attributes
    ----------
    starts : (f + 1) int64 array
        Free node i appears in the entries ``starts[i]:starts[i + 1]``.
    entries : (e) int32 array
        ``corner · (d + 1) + place``: the corner, and the node's place in it.
    slots : (e, d + 1) int32 array
        Position, among the Hessian's blocks, of the coupling to each node of that corner; −1 for a held node.
    row_starts, columns : (f + 1) int64, (b) int32 arrays
        Block rows of the Hessian.
    """

    starts: Integers
    entries: Shorts
    slots: Shorts
    row_starts: Integers
    columns: Shorts

    @cached_property
    def aggregates(self) -> Shorts:
        """For each free node (f) the group of neighbours that moves as one on the solver's coarse level."""
        n_free, most = len(self.row_starts) - 1, _AGGREGATES[self.slots.shape[1] - 1]
        size = max(_LEAST_AGGREGATE, math.ceil(n_free / most))
        return np.asarray(kernels.node_aggregates(self.row_starts, self.columns, size))

    def iterated(self, hessian: Floats, right: Floats, accuracy: float, most: int) -> Floats:
        """(f, d) the solution of H (b, d, d) x = right (f, d) by conjugate gradients, to this relative accuracy."""
        x = np.empty_like(right)
        pattern = self.row_starts, self.columns
        kernels.block_conjugate_gradients(*pattern, hessian, self.aggregates, right, accuracy, most, x)
        return x

    def assemble(self, blocks: NDArray[np.float32], d: int) -> Floats:
        """Hessian blocks (b, d, d) from the corners' blocks (c, d², d²), see :mod:`.distortion`."""
        hessian = np.empty((len(self.columns), d, d))
        self.reassemble(blocks, np.ones(len(blocks)), 0.0, hessian)
        return hessian

    def reassemble(self, blocks: NDArray[np.float32], weights: Floats, least_weight: float, hessian: Floats) -> None:
        """Update the Hessian (b, d, d) after the blocks of corners with large enough ``weights`` (c,) changed."""
        pattern = self.starts, self.entries, self.slots, self.row_starts
        kernels.assemble_corners(*pattern, blocks, weights, least_weight, hessian)


@dataclass(frozen=True, eq=False)
class CellAdjacency:
    """The cells of one type at each free node, in the same pattern of the Hessian.

    Attributes
    ----------
    starts : (f + 1) int64 array
    entries : (e) int32 array
        ``cell · k + place``.
    slots : (e, k) int32 array
    """

    starts: Integers
    entries: Shorts
    slots: Shorts

    def add(self, blocks: NDArray[np.float32], hessian: Floats) -> None:
        """Add the cells' blocks (m, k², d²) to the Hessian (b, d, d)."""
        kernels.add_cells(self.starts, self.entries, self.slots, blocks, hessian)


@dataclass(frozen=True, eq=False)
class FreeRegion:
    """Free nodes and the cells that touch them.

    Attributes
    ----------
    nodes : (l) int64 array
        Global numbers of the local nodes: the free ones first, then the other nodes of their cells.
    cell_numbers : (k) int64 array
        Global numbers of the cells.
    cells : CellTable
        The same cells in local node numbers.
    reference_sizes : (k) array, length^d, or CellsAtRest
    simplices : CornerSimplices
        Their corners, in local node numbers.
    """

    nodes: Integers
    n_free: int
    cell_numbers: Integers
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
        """The adjacency of each group."""
        pattern = self.adjacency.row_starts, self.adjacency.columns
        return tuple(
            CellAdjacency(*kernels.cell_adjacency(group.nodes, self.n_free, len(self.nodes), *pattern))
            for group in self.groups
        )

    @property
    def free(self) -> Integers:
        """Global numbers of the free nodes."""
        return self.nodes[: self.n_free]


def nodes_of_cells(cells: CellTable, chosen: Marks, n_nodes: int) -> Marks:
    """Mark (n) the nodes of the chosen (m) cells."""
    marked = np.zeros(n_nodes, dtype=bool)
    for block, span in cells.numbered:
        marked[block.nodes[chosen[span]]] = True
    return marked


def cells_of_nodes(cells: CellTable, marked: Marks) -> Marks:
    """Mark (m) the cells that have a marked (n) node."""
    return np.concatenate([kernels.touched_cells(block.nodes, marked).view(np.bool_) for block in cells])


def grow(cells: CellTable, marked: Marks, rings: int) -> Marks:
    """Marked nodes (n) and their neighbours through ``rings`` layers of cells."""
    for _ in range(rings):
        marked = nodes_of_cells(cells, cells_of_nodes(cells, marked), len(marked))
    return marked


def free_region(
    reference: Floats,
    cells: CellTable,
    reference_sizes: AtRest,
    free: Marks,
    *,
    chosen: Marks | None = None,
    at_rest: bool = False,
) -> FreeRegion:
    """Cut the region of the free nodes out of the mesh.

    Parameters
    ----------
    reference : (n, d) array, mesh length unit
        Nodes of the reference mesh.
    reference_sizes : (m,) array, length^d, or CellsAtRest
    free : (n,) bool array
        At least one node is free, and each belongs to a cell.
    chosen : (m,) bool array, optional
        Cells of the region; by default all that touch a free node.
    at_rest : bool
        Measure all corners against themselves at rest, and count the angles of quads and hexahedra.
    """
    chosen = cells_of_nodes(cells, free) if chosen is None else chosen
    marked = nodes_of_cells(cells, chosen, len(free))
    free = free & marked
    nodes = np.concatenate([np.flatnonzero(free), np.flatnonzero(marked & ~free)])
    n_free = int(np.count_nonzero(free))
    local = np.empty(len(free), dtype=np.int32)
    local[nodes] = np.arange(len(nodes))
    table = cells.chosen(chosen, local)
    sizes = reference_sizes[chosen]
    sizes = sizes.of_nodes(nodes) if isinstance(sizes, CellsAtRest) else sizes
    simplices = corner_simplices(reference[nodes], table, sizes, at_rest=at_rest, angles=at_rest)
    adjacency = NodeAdjacency(*kernels.node_adjacency(simplices.nodes, n_free, len(nodes), _diagonals(table)))
    return FreeRegion(nodes, n_free, np.flatnonzero(chosen), table, sizes, simplices, adjacency)


def _diagonals(cells: CellTable) -> Integers:
    """(h, 2) pairs of nodes that share a cell but no corner simplex: the diagonals of hexahedra."""
    pairs = [block.nodes[:, _DIAGONALS].reshape(-1, 2) for block in cells if block.type.name == "hexahedron"]
    return np.concatenate([*pairs, np.empty((0, 2), dtype=np.int64)])


def gathered(at: NodeAdjacency | CellAdjacency, shares: Floats) -> Floats:
    """Sums (f, d) at the free nodes of the shares (c, d + 1, d) of corners, or (m, k, d) of cells."""
    sums = np.empty((len(at.starts) - 1, shares.shape[2]))
    kernels.gather_shares(at.starts, at.entries, shares, sums)
    return sums
