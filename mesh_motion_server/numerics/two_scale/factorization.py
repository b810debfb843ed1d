"""The two scales joined: a :class:`TwoScalePlan` for a mesh, a :class:`TwoScaleFactorization` for each state of it.

``S = spline(coarse) + Σ compact levels``: the coarse interpolation is exact at its own points, the spline on the grid
nearly so, and the compact levels take what the spline leaves at all control points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mesh_motion_server.numerics.centres import padded
from mesh_motion_server.numerics.evaluation import LocalEvaluator
from mesh_motion_server.numerics.factorizations.conjugate_gradients import largest
from mesh_motion_server.numerics.interpolant import AllCentreFactorization, factorize
from mesh_motion_server.numerics.kernels import Basis, basis_named
from mesh_motion_server.numerics.spacing import local_spacing
from mesh_motion_server.numerics.two_scale.boxes import nested_boxes
from mesh_motion_server.numerics.two_scale.coarse_points import coarse_points
from mesh_motion_server.numerics.two_scale.compact_levels import CompactLevel, CompactSystem, compact_levels
from mesh_motion_server.numerics.two_scale.grid_sums import on_grid
from mesh_motion_server.numerics.two_scale.interpolant import TwoScaleInterpolant
from mesh_motion_server.numerics.two_scale.nested_grid import NestedGrid

__all__ = ["TwoScaleFactorization", "TwoScalePlan"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Coarse points by dimension. On the slab in a square 200 reach the quality of all 1300 boundary nodes to a hundredth,
#: on the wing in a cube 500 that of all 17 900 near the wall to a twentieth, with more no better.
_COARSE = {1: 100, 2: 200, 3: 500}
#: Least support radius in gaps between them.
_GAPS = 4.0


@dataclass(frozen=True, eq=False)
class TwoScalePlan:
    """What the reference mesh decides for all its states.

    Attributes
    ----------
    coarse : (m,) int64 array
        Control points of the coarse interpolation.
    gap : float, mesh length unit
        Largest distance of a control point from the nearest coarse one.
    levels : list of CompactLevel
        Widest first.
    basis, support_radius, polynomial
        Of the coarse interpolation, as in :func:`~mesh_motion_server.numerics.interpolant.factorize`.
    """

    coarse: Indices
    gap: float
    levels: list[CompactLevel]
    basis: str
    support_radius: float | None
    polynomial: str

    @property
    def least_radius(self) -> float:
        """Below it a compact basis does not join the coarse points to a field, mesh length unit."""
        return _GAPS * self.gap

    @property
    def joined(self) -> bool:
        """Whether the support radius joins them."""
        radius = self.support_radius
        return radius is None or radius >= self.least_radius or not basis_named(self.basis).compact

    @classmethod
    def build(
        cls,
        reference: Floats,
        moving: NDArray[np.bool_],
        *,
        basis: str,
        support_radius: float | None,
        polynomial: str = "auto",
        count: int | None = None,
    ) -> TwoScalePlan:
        """Choose ``count`` coarse points and the levels.

        Parameters
        ----------
        reference : (n, d) array, mesh length unit
            Control points of the reference mesh.
        moving : (n,) bool array
            Which of them move.
        count : int, optional
            Coarse points; by default by the dimension.
        """
        points, spacing = padded(reference), local_spacing(reference)
        chosen = coarse_points(points, spacing, moving, count or _COARSE[reference.shape[1]])
        gap = float(cKDTree(points[chosen]).query(points)[0].max())
        return cls(chosen, gap, compact_levels(points, spacing, moving), basis, support_radius, polynomial)

    def factorize(self, points: Floats, low: Floats, high: Floats) -> TwoScaleFactorization:
        """Prepare the interpolation from control points (n, d) to places between ``low`` and ``high`` (d,).

        Raises
        ------
        NumericalError
            If the coarse matrix is singular to working precision.
        """
        chosen = np.ascontiguousarray(points[self.coarse])
        coarse = factorize(
            chosen, basis=self.basis, support_radius=self.support_radius, polynomial=self.polynomial, solver="dense"
        )
        corners = padded(np.stack([low, high]))
        grid = NestedGrid(nested_boxes(padded(chosen), corners[0], corners[1]), corners[0], points.shape[1])
        systems = [CompactSystem.build(level, points) for level in self.levels]
        return TwoScaleFactorization(points, self.coarse, coarse, grid, systems)


@dataclass(frozen=True, eq=False)
class TwoScaleFactorization:
    """A :class:`~mesh_motion_server.numerics.interpolant.Factorization` in two scales.

    Attributes
    ----------
    control_points : (n, d) array, mesh length unit
    chosen : (m,) int64 array
        The coarse ones among them.
    coarse : AllCentreFactorization
    grid : NestedGrid
    systems : list of CompactSystem
        Widest first; the last has all control points.
    """

    control_points: Floats
    chosen: Indices
    coarse: AllCentreFactorization
    grid: NestedGrid
    systems: list[CompactSystem]

    @property
    def solver(self) -> str:
        return "two-scale"

    @property
    def basis(self) -> Basis:
        return self.coarse.basis

    @property
    def support_radius(self) -> float:
        return self.coarse.support_radius

    @property
    def nbytes(self) -> int:
        """Memory it holds."""
        return self.coarse.nbytes + self.control_points.nbytes + sum(system.nbytes for system in self.systems)

    def solve(self, values: Floats) -> TwoScaleInterpolant:
        """Interpolant of (n, k) values at the control points."""
        values = np.ascontiguousarray(values, dtype=np.float64)
        evaluator = LocalEvaluator()
        coarse = self.coarse.solve(values[self.chosen])
        spline = self.grid.spline(on_grid(coarse, self.grid, evaluator))
        left = np.empty_like(values)
        spline.values(self.control_points, left)
        np.subtract(values, left, out=left)
        levels, iterations, scale = [], 0, largest(values)
        for system in self.systems:
            last = system is self.systems[-1]
            level, taken = system.solve(left, scale, last=last)
            levels.append(level)
            iterations += taken
            if not last:
                left -= evaluator.displacement(level, self.control_points)
        return TwoScaleInterpolant(spline, tuple(levels), self.basis, iterations)
