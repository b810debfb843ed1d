"""Control points arranged for the compiled sums: sorted by the cells of a uniform grid, one array per coordinate.

With a compact basis only centres closer than R count. If R is small against the extent of the centres, a grid of cells
of side R finds them: those near a point lie in the 3ᵈ cells around it, and the three along x are one run of the sorted
arrays. Otherwise the grid has a single cell and every centre is visited: a direct sum.

The layout depends only on the control points and the radius, not on the points of evaluation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import mesh_motion_kernels as kernels
import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers, Marks, Shorts
from mesh_motion_numerics.interpolation.kernels import Basis
from mesh_motion_numerics.mesh.points import padded


@dataclass(frozen=True, eq=False)
class HashedCells:
    """Points sorted by the cells of a grid that stores only the cells next to a point.

    If the cells are far smaller than the domain, as around a small body in a large domain, a grid with all its cells
    would not fit into memory, and one with larger cells would find thousands of points that are not near. A stored cell
    lists the points of all 27 cells around it: one lookup finds them, or finds none.
    """

    order: Integers  # (n,). Row ``j`` of the sorted arrays is point ``order[j]``
    coordinates: Floats  # (3, n)
    origin: Floats  # (3,)
    inverse_side: float
    #: (t,). A hash table of the stored cells by their place in the grid, −1 in free entries; t is a power of two. For
    #: points on a surface about a third of it is used.
    keys: Integers
    spans: Shorts  # (t, 2) int32. [first, last) of each cell's runs
    runs: Shorts  # (r, 2) int32. [first, last) of sorted points

    @classmethod
    def build(cls, points: Floats, origin: Floats, extent: float, side: float) -> HashedCells:
        """Sort points (n, 3) by cells of the given side; by wider cells if an axis would have a million of them.

        The points may be a part of all points, which reach from the ``origin`` (3,) at most ``extent`` along each axis.
        """
        return cls(*kernels.store_cells(points, origin, extent, side))


@dataclass(frozen=True, eq=False)
class CentreLayout:
    """Sorted centres and the grid that finds them."""

    order: Integers  # (nc,). Row ``j`` of the sorted arrays is control point ``order[j]``
    coordinates: Floats  # (3, nc)
    origin: Floats  # (3,). Lower corner of all centres
    inverse_side: float  # 0 for a single cell
    extent: float  # extent of all centres along their longest axis
    shape: Integers  # (3,). Cells along each axis
    starts: Integers  # (n_cells + 1,). First sorted centre of each cell, x fastest
    fraction: float  # mean share of the centres in the cells around a centre, which a sum visits

    @classmethod
    def build(cls, control_points: Floats, basis: Basis, support_radius: float) -> CentreLayout:
        """Arrange (nc, d) control points, by cells if the basis is compact and that saves enough."""
        reach = support_radius if basis.compact else 0.0
        return cls(*kernels.lay_out_centres(padded(control_points), reach))

    @classmethod
    def on_grid(
        cls, control_points: Floats, origin: Floats, inverse_side: float, extent: float, shape: Integers
    ) -> CentreLayout:
        """Arrange a part (nc, d) of the control points on the grid of all points: all points of some of its cells."""
        return cls(*kernels.lay_out_on_grid(padded(control_points), origin, inverse_side, extent, shape))

    @property
    def n_centres(self) -> int:
        return self.order.size

    @property
    def is_direct(self) -> bool:
        """Whether every centre is visited for every point."""
        return self.starts.size == 2

    @cached_property
    def grid(self) -> tuple[Floats, float, Integers, Integers]:
        """The arguments of the compiled loops for the grid."""
        return self.origin, self.inverse_side, self.shape, self.starts

    def within_reach(self, points: Floats) -> Integers:
        """Rows (r,) of (n, d) points with a centre in their cell or next to it; for the others every sum is zero."""
        inside = np.empty(len(points), dtype=np.bool_)
        kernels.mark_reached(
            np.ascontiguousarray(points), self.origin, self.inverse_side, self.shape, self._reached_cells, inside
        )
        return np.flatnonzero(inside)

    def product(self, basis: Basis, support_radius: float, points: Floats, vectors: Floats) -> Floats:
        """(n, k) sums Σ_j φ(|x − x_j| / R) v_j at padded points (n, 3), with vectors (nc, k) in the layout's order."""
        out, rows = np.empty((len(points), vectors.shape[1])), np.ascontiguousarray(vectors.T)
        kernels.sum_values(basis.code, points, self.coordinates, rows, 1.0 / support_radius, *self.grid, out)
        return out

    def small_cells(self, side: float) -> HashedCells:
        """The sorted centres by cells of another side, cached."""
        if side not in self._by_side:
            points = np.ascontiguousarray(self.coordinates.T)
            self._by_side[side] = HashedCells.build(points, self.origin, self.extent, side)
        return self._by_side[side]

    @cached_property
    def _by_side(self) -> dict[float, HashedCells]:
        return {}

    @cached_property
    def _reached_cells(self) -> Marks:
        """Whether a cell or a neighbour contains a centre: flat, x fastest, with one extra cell on each side."""
        reached = np.zeros(int(np.prod(self.shape + 2)), dtype=np.bool_)
        kernels.mark_neighbours(self.starts, self.shape, reached)
        return reached
