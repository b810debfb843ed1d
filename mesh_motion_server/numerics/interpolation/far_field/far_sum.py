"""The sum of an interpolant over its centres at many points, far centres through polynomials in boxes.

Costs are counted in evaluations of a basis function, about a nanosecond.

References
----------
W. Fong, E. Darve, "The black-box fast multipole method", J. Comput. Phys. 228 (2009) 8712–8725 (kernels interpolated at
Chebyshev points). L. Wilson, N. Vaughn, R. Krasny, "A GPU-accelerated fast multipole method based on barycentric
Lagrange interpolation and dual tree traversal", Comput. Phys. Commun. 265 (2021) 108017. Here the points alone are
grouped, since a mesh has many times more nodes than its boundary, and the orders are chosen pair by pair from a bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.interpolation.far_field.box_tree import BoxTree
from mesh_motion_server.numerics.interpolation.far_field.derivative_bounds import derivative_bounds
from mesh_motion_server.numerics.interpolation.far_field.plan import Plan, Runs, make_plan
from mesh_motion_server.numerics.interpolation.interpolant import Interpolant
from mesh_motion_server.numerics.threads import limited_to

__all__ = ["FarSum"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Most points of a leaf, and centres of one.
_POINTS, _CENTRES = 512, 48
#: A polynomial's evaluation at a point: for each of its values, and for its Lagrange functions.
_A_VALUE, _A_POINT = 0.35, 100.0
#: Carrying a polynomial to a child, for each product.
_A_PRODUCT = 0.5


@dataclass(frozen=True, eq=False)
class FarSum:
    """``Σ_j γ_j φ(|x − x_j|/R)`` at given points, planned.

    Attributes
    ----------
    interpolant : Interpolant
        Its polynomial is left out.
    points, centres : BoxTree
        Of the points and of the control points.
    weights : (k, nc) array
        In the order of ``centres``.
    plan : Plan
    """

    interpolant: Interpolant
    points: BoxTree
    centres: BoxTree
    weights: Floats
    plan: Plan

    @classmethod
    def build(cls, interpolant: Interpolant, points: Floats, *, tolerance: float) -> FarSum:
        """Plan the sum at points (n ≥ 1, d), each value within ``tolerance`` of the direct sum's.

        Parameters
        ----------
        interpolant : Interpolant
        points : (n, d) array
        tolerance : float, unit of the values
            Of the Euclidean norm over the components.
        """
        boxes = BoxTree.build(points, leaf=_POINTS)
        centres = BoxTree.build(interpolant.control_points, leaf=_CENTRES)
        weights = interpolant.weights[centres.order]
        sums = np.concatenate([[0.0], np.cumsum(np.sqrt(np.sum(weights**2, axis=1)))])
        span = np.maximum(boxes.high[0], centres.high[0]) - np.minimum(boxes.low[0], centres.low[0])
        furthest = float(np.sqrt(np.sum(span**2))) / interpolant.support_radius
        plan = make_plan(
            boxes,
            centres,
            sums[centres.points_of[:, 1]] - sums[centres.points_of[:, 0]],
            derivative_bounds(interpolant.basis, furthest),
            dimension=interpolant.dimension,
            radius=interpolant.support_radius,
            tolerance=tolerance / float(sums[-1]) if sums[-1] > 0.0 else np.inf,
        )
        return cls(interpolant, boxes, centres, np.ascontiguousarray(weights.T), plan)

    @property
    def bound(self) -> float:
        """No value is further than this from the direct sum, rounding aside; at most the tolerance."""
        return float(self.plan.bound[self.points.leaves].max())

    @property
    def direct_work(self) -> float:
        """Cost of the direct sum."""
        return float(len(self.points.points) * self.interpolant.layout.fraction * self.weights.shape[1])

    @property
    def work(self) -> float:
        """Cost of this sum."""
        k, d = self.weights.shape[0], self.interpolant.dimension
        far, near, tree = self.plan.far, self.plan.near, self.points
        order, leaves = self._orders, tree.leaves[self._orders[tree.leaves] > 0]
        sizes = np.diff(tree.points_of, axis=1)[leaves, 0]
        return float(
            np.sum(np.diff(tree.points_of, axis=1)[near.box, 0] * near.centres)
            + np.sum(far.order**d * far.centres)
            + np.sum(sizes * (_A_VALUE * k * order[leaves] ** d + _A_POINT))
            + _A_PRODUCT * k * (np.sum(order ** (d + 1)) + np.sum(far.order ** (d + 1)))
        )

    def values(self, *, threads: int | None = None) -> Floats:
        """(n, k) values: sums over near centres, polynomials of all boxes, what these are at the points."""
        tree, near = self.points, self.plan.near
        n, k, d = len(tree.points), self.weights.shape[0], self.interpolant.dimension
        out = np.zeros((n, k))
        with limited_to(threads):
            self._sums(near, tree.points, tree.points_of[near.box], out)
            starts, values = self._polynomials(d, k)
            boxes = (tree.low, tree.high, self._orders, starts)
            kernels.add_polynomials(tree.leaves, tree.points_of, tree.points, *boxes, values, d, out)
        unsorted = np.empty_like(out)
        unsorted[tree.order] = out
        return unsorted

    def _sums(self, runs: Runs, points: Floats, points_of: Indices, out: Floats) -> None:
        """Sums at the points (n, 3) of each group (g, 2) into ``out`` (n, k)."""
        kernels.sum_groups(
            self.interpolant.basis.code,
            points,
            points_of,
            runs.starts,
            runs.runs,
            np.ascontiguousarray(self.centres.points.T),
            self.weights,
            1.0 / self.interpolant.support_radius,
            out,
        )

    @cached_property
    def _orders(self) -> Indices:
        """(b,) order of each box's polynomial, at least that of its parent; 0 where there is none."""
        tree, far = self.points, self.plan.far
        order = np.zeros(tree.n_boxes, dtype=np.int64)
        np.maximum.at(order, far.box, far.order)
        for first, last in zip(tree.levels[1:-1], tree.levels[2:], strict=True):
            order[first:last] = np.maximum(order[first:last], order[tree.parent[first:last]])
        return order

    def _polynomials(self, d: int, k: int) -> tuple[Indices, Floats]:
        """First value (b + 1,) and values of the polynomial of each box."""
        tree, far = self.points, self.plan.far
        rows = np.append(0, np.cumsum(far.order**d))
        places, sums = np.empty((rows[-1], 3)), np.empty((rows[-1], k))
        kernels.box_points(far.box, far.order, rows, d, tree.low, tree.high, places)
        self._sums(far, places, np.stack([rows[:-1], rows[1:]], axis=1), sums)
        starts = np.append(0, np.cumsum(self._orders**d * k))
        values = np.empty(starts[-1])
        groups = (np.searchsorted(far.box, np.arange(tree.n_boxes + 1)), far.order, rows, sums)
        boxes = (tree.low, tree.high, self._orders, starts)
        kernels.carry_down(tree.levels, tree.parent, *boxes, *groups, d, values)
        return starts, values
