"""Projected Gauss–Newton iterations that lower the distortion of a free region.

Each iteration solves ``H dx = −g`` with the positive semi-definite Hessian of :mod:`.distortion` and moves along dx as
far as Armijo's rule allows; beyond the barrier the distortion is infinite, so no cell can invert. Small systems are
factorized, large ones are solved roughly by conjugate gradients preconditioned with the diagonal blocks: an inexact
Newton method needs no more accuracy (Dembo, Eisenstat & Steihaug, SIAM J. Numer. Anal. 19, 1982).

:class:`Accuracy` has the criteria for the end.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.correction.boundary_constraint import RegionConstraint
from mesh_motion_numerics.correction.distortion import FLOOR, PNorm
from mesh_motion_numerics.correction.free_region import FreeRegion, NodeAdjacency
from mesh_motion_numerics.correction.linked_unknowns import StepSolver
from mesh_motion_numerics.correction.region_measure import RegionMeasure, region_measure
from mesh_motion_numerics.interpolation.sparse_rows import Elimination, SparseCholesky
from mesh_motion_numerics.stopwatch import check_time

_ARMIJO, _HALVINGS = 1e-4, 25
_UNTANGLING_CG = 0.05, 200  # rough steps do not untangle large meshes
_UNTANGLING_DIRECT = 1500  # a larger factorization still untangles a half turn, where rough steps sometimes fail


@dataclass(frozen=True)
class Accuracy:
    """The criteria for the end of the iterations, and their accuracy; the defaults are for a correction in one step.

    Attributes
    ----------
    full_step_gain : float
        The iterations have converged if a full Newton step gains less. This does not apply to short steps near det = 0.
    least_decrement, least_gain : float
        Stop if the model predicts a gain below ``least_decrement``, or if a step of any length gained less than
        ``least_gain``.
    refresh : float
        Share of the mean weight: lighter corners keep the curvature of an earlier iteration.
    floor : float
        Smallest weight of a corner in the Hessian, as a share of the mean; without this floor a light node has no
        stiffness.
    direct_unknowns : int
        Largest system that is factorized; above it conjugate gradients are faster, in 2D by twice at 1300 unknowns.
    cg_reduction, cg_iterations : float, int
        Conjugate gradients: reduction of the residual, largest number of iterations.
    """

    full_step_gain: float = 1e-3
    least_decrement: float = 1e-3
    least_gain: float = 1e-7
    refresh: float = 0.003
    floor: float = FLOOR
    direct_unknowns: int = 900
    cg_reduction: float = 0.2
    cg_iterations: int = 60


@dataclass(frozen=True, eq=False)
class Descent:
    """Result of :func:`newton`: points (l, d), distortion E, number of iterations, measure."""

    points: Floats
    distortion: float
    iterations: int
    measure: RegionMeasure


def newton(
    points: Floats,
    region: FreeRegion,
    norm: PNorm,
    *,
    iterations: int = 12,
    good_enough: Callable[[Floats], bool] | None = None,
    solve: StepSolver | None = None,
    accuracy: Accuracy | None = None,
    constraint: RegionConstraint | None = None,
    earlier: RegionMeasure | None = None,
) -> Descent:
    """Lower E, starting at the points (l, d) of the region; nodes that are not free keep their bits.

    Parameters
    ----------
    points : (l, d) array, mesh length unit
    iterations : int
        Largest number of iterations.
    good_enough : callable, optional
        Called with the points after every second iteration; true stops.
    solve : StepSolver, optional
        Gives the step; by default every free node moves on its own.
    constraint : RegionConstraint, optional
        The constraint of free nodes that slide or move together; the points must be admissible.
    earlier : RegionMeasure, optional
        The measure of the last descent in the same region; its curvature is reused for light corners or cells.
    """
    accuracy = accuracy or Accuracy()
    if solve is None:
        most, rough = accuracy.direct_unknowns, (accuracy.cg_reduction, accuracy.cg_iterations)
        if norm.epsilon > 0.0:
            most, rough = _UNTANGLING_DIRECT, _UNTANGLING_CG
        solve = partial(_solve, elimination=_elimination(points, region, constraint, most), rough=rough)
    measure = region_measure(region, norm, earlier)
    energy, weights = measure.mean(points)
    done = 0
    while done < iterations and math.isfinite(energy):
        check_time()
        gradient = measure.gradient(points, weights)
        hessian = measure.hessian(points, weights, refresh=accuracy.refresh, floor=accuracy.floor)
        if constraint is None:
            step = solve(region.adjacency, hessian, -gradient)
        else:
            step = constraint.step(points, hessian, -gradient, solve)
        slope = float(np.vdot(gradient, step))
        found = _line_search(points, measure, step, energy, slope, constraint)
        if found is None:
            break
        length, points, lower, weights = found
        gain, energy, done = energy - lower, lower, done + 1
        converged = length == 1.0 and gain < accuracy.full_step_gain
        if converged or -slope < accuracy.least_decrement or gain < accuracy.least_gain:
            break
        if good_enough is not None and done % 2 == 0 and good_enough(points):
            break
    return Descent(points, energy, done, measure)


def _line_search(
    points: Floats,
    measure: RegionMeasure,
    step: Floats,
    energy: float,
    slope: float,
    constraint: RegionConstraint | None,
) -> tuple[float, Floats, float, Floats] | None:
    """Halve the step (f, d) until Armijo's rule holds: (length, points, E, w), or None if the step gets too short."""
    if not slope < 0.0:
        return None
    length = 1.0
    for _ in range(_HALVINGS + 1):
        trial = points.copy()
        trial[: len(step)] += length * step
        admitted = trial if constraint is None else constraint.retract(points, trial)
        if admitted is not None:
            lower, weights = measure.mean(admitted)
            if lower <= energy + _ARMIJO * length * slope:
                return length, admitted, lower, weights
        length *= 0.5
    return None


def _elimination(
    points: Floats, region: FreeRegion, constraint: RegionConstraint | None, most: int
) -> Elimination | None:
    """Order and pattern of the Newton systems' factor, None if they have more than ``most`` unknowns."""
    adjacency, places = region.adjacency, points[: region.n_free]
    if constraint is not None:
        adjacency, places = constraint.links.adjacency, places[constraint.links.roots]
    if places.size > most:
        return None
    return Elimination.of(adjacency.row_starts, adjacency.columns, places)


def _solve(
    adjacency: NodeAdjacency, hessian: Floats, right: Floats, elimination: Elimination | None, rough: tuple[float, int]
) -> Floats:
    """The step (f, d) of H (b, d, d) dx = right (f, d); ``rough`` is the accuracy if conjugate gradients are needed."""
    if elimination is not None:
        factor = SparseCholesky.build(adjacency.row_starts, adjacency.columns, hessian, elimination)
        if factor is not None:
            return factor.solve(right)
    return adjacency.iterated(hessian, right, *rough)  # also for a singular matrix: they stay in its range
