"""The two scales joined: a :class:`TwoScalePlan` for a mesh, a :class:`TwoScaleFactorization` for each state of it.

``S = coarse + Σ compact levels``: the coarse interpolation is exact at its own points, and the compact levels correct
its error at all control points. With many control points, few are coarse points, and a spline on a grid replaces their
sums. With few control points, all are coarse points as long as the matrix is not singular: at points much closer than
its support radius a smooth function has equal values up to rounding. The smallest eigenvalue of the matrix of
Wendland's C2 function is about 25 (h/R)³ for points with spacing h.

The coarse interpolation may be smoothed (:mod:`.smoothing`): as the levels correct its error, S stays exact. Without
smoothing it continues the differences of close control points far into the mesh: noise of the boundary, or its rounding
errors, reach the nodes 10 to 1000 times as large.

Control points at the same place (the two sides of a baffle, or of an interface) count as one point with their mean
value.

References
----------
H. Wendland, *Scattered Data Approximation*, Cambridge 2005, ch. 12 (stability). M. S. Floater, A. Iske, J. Comput.
Appl. Math. 73 (1996) 65–78 (levels).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import AllCentreFactorization, Interpolant, factorize
from mesh_motion_numerics.interpolation.kernels import basis_named
from mesh_motion_numerics.interpolation.two_scale.boxes import nested_boxes
from mesh_motion_numerics.interpolation.two_scale.coarse_points import coarse_points, separated_points
from mesh_motion_numerics.interpolation.two_scale.compact_levels import (
    CompactLevel,
    CompactSystem,
    compact_levels,
    levels_below,
    levels_of_all,
)
from mesh_motion_numerics.interpolation.two_scale.grid_sums import on_grid
from mesh_motion_numerics.interpolation.two_scale.interpolant import TwoScaleInterpolant
from mesh_motion_numerics.interpolation.two_scale.nested_grid import NestedGrid
from mesh_motion_numerics.interpolation.two_scale.smoothing import Smoothing
from mesh_motion_numerics.mesh.coincidence import first_at_place
from mesh_motion_numerics.mesh.neighbours import local_spacing
from mesh_motion_numerics.mesh.points import padded
from mesh_motion_numerics.mesh.roles import BoundaryRoles
from mesh_motion_numerics.method import Method

AUTOMATIC_FROM = 1000
"""Number of control nodes above which the coarse field has few of them and is a spline on a grid. With 1300 control
nodes and 98 000 nodes in 2D a step takes a quarter of the time with all of them, with 5900 and 50 000 in 3D a
twentieth."""


#: Number of coarse points if there are many control points, by dimension. On the slab in a square 200 reach the quality
#: of all 1300 boundary nodes to a hundredth, on the wing in a cube 500 that of all 17 900 near the wall to a twentieth;
#: more points are not better.
_COARSE = {1: 100, 2: 200, 3: 500}
#: Smallest support radius in units of the gaps between coarse points.
_GAPS = 4.0
#: Sliding nodes are joined up to this distance from the moving ones, in support radii: further away they hardly move.
_JOINED = 0.25
#: Smallest distance of two coarse points in support radii, for many and for few control points: with the first the
#: matrix keeps six digits. The second gives smaller rounding errors of the weights: first cells of 1e-8 chords keep
#: their height to 0.4 % when an aerofoil turns by 45°, to 2 % with 2e-4.
_OF_MANY, SEPARATION = 2e-4, 1e-3


@dataclass(frozen=True, eq=False)
class TwoScalePlan:
    """The choices made from the reference mesh for all its states."""

    coarse: Integers  # (m,). Control points of the coarse interpolation
    gap: float  # mesh length unit. Largest distance of a joined control point from the nearest coarse one
    levels: list[CompactLevel]  # The levels, widest first; numbers are rows of :attr:`distinct`
    #: basis, support_radius: Those of the coarse interpolation, as in
    #: :func:`~mesh_motion_numerics.interpolation.interpolant.factorize`.
    basis: str
    support_radius: float | None
    gridded: bool  # Whether a spline on a grid replaces the coarse sums
    place: Integers  # (n,). For each control point the first one at its place
    smoothing: Smoothing | None = None  # Of the coarse interpolation

    @property
    def usable(self) -> bool:
        """Whether it is better than one scale: R connects a grid's coarse points, or not all points are coarse."""
        if not self.gridded:
            return bool(self.levels) or len(self.coarse) < len(self.place)
        radius = self.support_radius
        return radius is None or radius >= _GAPS * self.gap or not basis_named(self.basis).compact

    @cached_property
    def distinct(self) -> Integers:
        """(c,) the first control point at each place, ascending."""
        return np.flatnonzero(self.place == np.arange(len(self.place)))

    @classmethod
    def build(
        cls,
        reference: Floats,
        moving: Marks,
        *,
        joined: Marks | None = None,
        basis: str,
        support_radius: float | None,
        count: int | None = None,
        gridded: bool = True,
        smoothing: Smoothing | None = None,
    ) -> TwoScalePlan:
        """Choose the coarse points and the levels.

        Parameters
        ----------
        reference : (n, d) array, mesh length unit
            Control points of the reference mesh.
        moving : (n,) bool array
            Which control points move.
        joined : (n,) bool array, optional
            Which of them the coarse interpolation must join to one field; by default all.
        count : int, optional
            Number of coarse points with a grid; by default chosen by the dimension.
        gridded : bool
            If false, all control points that are far enough from each other are coarse points.
        """
        place = first_at_place(reference, float(np.ptp(reference, axis=0).max()))
        distinct = np.flatnonzero(place == np.arange(len(place)))
        points, moves = padded(reference[distinct]), moving[distinct]
        spacing = local_spacing(reference[distinct])
        compact = basis_named(basis).compact and support_radius is not None
        share = _OF_MANY if gridded else SEPARATION
        separation = share * float(support_radius or 0.0) if compact else 0.0
        if gridded:
            chosen = coarse_points(points, spacing, moves, count or _COARSE[reference.shape[1]], separation)
        else:
            chosen = separated_points(points, separation) if separation > 0.0 else np.arange(len(points))
        away = cKDTree(points[chosen]).query(points)[0]
        joined = moving if joined is None else joined
        if gridded:
            levels = compact_levels(points, spacing, moves, coarse=chosen, gap=float(away.max()))
        elif smoothing is not None:
            levels = levels_of_all(points, spacing, moves, smoothing.radii)
        elif len(chosen) < len(points):
            levels = levels_below(reference[distinct], spacing, separation, coarse=chosen)
        else:
            levels = []
        gap = float(away[joined[distinct]].max(initial=0.0))
        return cls(distinct[chosen], gap, levels, basis, support_radius, gridded, place, smoothing)

    def factorize(self, points: Floats, low: Floats, high: Floats) -> TwoScaleFactorization:
        """Prepare the interpolation from control points (n, d) to places between ``low`` and ``high`` (d,).

        Raises QualityRefused if the coarse matrix is singular to working precision.
        """
        chosen = np.ascontiguousarray(points[self.coarse])
        spacing = local_spacing(chosen)
        coarse = factorize(
            chosen,
            basis=self.basis,
            support_radius=self.support_radius,
            solver="dense",
            spacing=spacing,
            smoothing=self._shares(chosen, spacing),
        )
        corners = padded(np.stack([low, high]))
        grid = self._grid(padded(chosen), spacing, corners, points.shape[1]) if self.gridded else None
        distinct = points.take(self.distinct, axis=0)
        systems = [CompactSystem.build(level, distinct) for level in self.levels]
        return TwoScaleFactorization(points, self, coarse, grid, systems)

    def _shares(self, points: Floats, spacing: Floats) -> Floats | None:
        """λ of the coarse points (m, d) with their spacing (m,); None without smoothing."""
        if self.smoothing is None:
            return None
        return self.smoothing.shares(basis_named(self.basis), float(self.support_radius or 0.0), points, spacing)

    def _grid(self, chosen: Floats, spacing: Floats, corners: Floats, dimension: int) -> NestedGrid:
        """The grid of a domain between two corners (2, 3), refined around the coarse points (m, 3)."""
        if basis_named(self.basis).compact and self.support_radius is not None:
            corners[0] = np.maximum(corners[0], chosen.min(axis=0) - self.support_radius)
            corners[1] = np.minimum(corners[1], chosen.max(axis=0) + self.support_radius)
        return NestedGrid(nested_boxes(chosen, spacing, corners[0], corners[1]), corners[0], dimension)


def plans_for(
    points: Floats, sets: Sequence[Integers], roles: BoundaryRoles, method: Method, smoothing: Smoothing | None = None
) -> dict[bytes, TwoScalePlan]:
    """The plans of those of the ``sets`` of control nodes (c,) that need two scales, by the bytes of the nodes.

    ``points`` (n, d) are those of the mesh. There is no plan if the method reduces the control points or its basis is
    not compact.
    """
    if method.reduction != "none" or not basis_named(method.basis).compact:
        return {}
    planned = {nodes.tobytes(): plan_for(points, nodes, roles, method, smoothing) for nodes in sets}
    return {nodes: plan for nodes, plan in planned.items() if plan.usable}


def plan_for(
    points: Floats, nodes: Integers, roles: BoundaryRoles, method: Method, smoothing: Smoothing | None = None
) -> TwoScalePlan:
    """Make the plan for control nodes (c,) of the mesh ``points`` (n, d)."""
    moving = ~np.isin(nodes, roles.fixed)  # sliding nodes also move
    joined = moving.copy()
    if method.support_radius is not None and len(roles.sliding):
        sliding = np.flatnonzero(np.isin(nodes, roles.sliding))
        away = cKDTree(points[roles.moving]).query(points[nodes[sliding]])[0]
        joined[sliding[away > _JOINED * method.support_radius]] = False
    return TwoScalePlan.build(
        points[nodes],
        moving,
        joined=joined,
        basis=method.basis,
        support_radius=method.support_radius,
        gridded=len(nodes) > AUTOMATIC_FROM,
        smoothing=smoothing,
    )


@dataclass(frozen=True, eq=False)
class TwoScaleFactorization:
    """A :class:`~mesh_motion_numerics.interpolation.interpolant.Factorization` in two scales."""

    control_points: Floats  # (n, d), mesh length unit
    plan: TwoScalePlan
    coarse: AllCentreFactorization
    grid: NestedGrid | None  # None if the coarse sums are evaluated directly
    systems: list[CompactSystem]  # Widest first; the last has all distinct control points

    def solve(self, values: Floats) -> TwoScaleInterpolant:
        """Return the interpolant of (n, k) values at the control points; at the same place their mean counts."""
        values = self.averaged(np.ascontiguousarray(values, dtype=np.float64))
        distinct, points = self.plan.distinct, self.control_points
        field = self.coarse.solve(values[self.plan.coarse])
        coarse = field if self.grid is None else self.grid.spline(on_grid(field, self.grid))
        scale = float(np.abs(values).max(initial=0.0))
        if len(distinct) < len(points):
            points, values = points[distinct], values[distinct]
        left = evaluation.displacement(coarse, points)
        np.subtract(values, left, out=left)
        levels = []
        for system in self.systems:
            last = system is self.systems[-1]
            levels.append(system.solve(left, scale, last=last))
            if not last:
                left -= evaluation.displacement(levels[-1], points)
        return TwoScaleInterpolant(coarse, tuple(levels))

    @cached_property
    def weightless(self) -> TwoScaleInterpolant:
        """An interpolant without components, which has the coarse points and the levels."""
        coarse = self.coarse
        nothing = np.empty((len(coarse.control_points), 0))
        field = Interpolant(coarse.control_points, nothing, coarse.basis, coarse.support_radius, coarse.layout)
        levels = tuple(system.interpolant(np.empty((len(system.points), 0))) for system in self.systems)
        return TwoScaleInterpolant(field, levels)

    def averaged(self, values: Floats) -> Floats:
        """The values (n, k) with the mean of each place at its first point."""
        place = self.plan.place
        if len(self.plan.distinct) == len(place):
            return values
        total = np.zeros_like(values)
        np.add.at(total, place, values)
        return np.asarray(total[place] / np.bincount(place, minlength=len(place))[place, None])
