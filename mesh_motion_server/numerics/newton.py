"""Projected Gauss–Newton iterations that lower the distortion of a free region.

Each iteration solves ``H dx = −g`` with the positive semi-definite Hessian of :mod:`.curvature` and goes along dx as
far as Armijo's rule allows; outside the barrier the distortion is infinite, so no cell can invert. Small systems are
factorized, large ones are solved roughly by conjugate gradients preconditioned with the diagonal blocks: an inexact
Newton method needs no more (Dembo, Eisenstat & Steihaug, SIAM J. Numer. Anal. 19, 1982).

A :class:`QuadraticTerm` may be added to the distortion, and :class:`Accuracy` says where to stop.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray
from scipy.sparse import bsr_matrix
from scipy.sparse.linalg import splu

from mesh_motion_server.numerics.curvature import FLOOR
from mesh_motion_server.numerics.distortion import PNorm
from mesh_motion_server.numerics.free_region import FreeRegion, NodeAdjacency
from mesh_motion_server.numerics.node_constraint import RegionConstraint, StepSolver
from mesh_motion_server.numerics.region_measure import RegionMeasure, region_measure
from mesh_motion_server.numerics.thread_share import threads_for

__all__ = ["Accuracy", "Descent", "QuadraticTerm", "StepSolver", "newton"]

_ARMIJO, _HALVINGS = 1e-4, 25
_UNTANGLING_CG = 0.05, 200  # rough steps do not untangle large meshes
_UNTANGLING_DIRECT = 1500  # nor always a half turn, which a larger factorization still does
_ROWS = 512
_BLOCKS_PER_THREAD = 50_000  # of the Hessian: a product with fewer is over before another thread has started


@dataclass(frozen=True)
class Accuracy:
    """Where the iterations stop, and how accurate each of them is; the defaults serve a correction in one step.

    Attributes
    ----------
    full_step_gain : float
        A full Newton step that gains less: converged. On short steps, near det = 0, it says nothing.
    least_decrement, least_gain : float
        Stop where the model promises less than the first, or a step of any length gained less than the second.
    refresh : float
        Of the mean weight: lighter corners keep the curvature of an earlier iteration.
    floor : float
        Least weight of a corner in the Hessian, of the mean weight; without it a light node has no stiffness.
    direct_unknowns : int
        Largest system that is factorized; above it conjugate gradients are faster, in 2D by twice at 1300 unknowns.
    cg_reduction, cg_iterations : float, int
        Of the conjugate gradients: reduction of the residual, most iterations.
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
class QuadraticTerm:
    """½ vᵀ K v with v = x − rest, of the free nodes; added to the distortion.

    Attributes
    ----------
    rest : (f, d) array, mesh length unit
    stiffness : (b, d, d) array, 1 / length²
        K, symmetric and positive semi-definite, in the pattern of the region's :class:`NodeAdjacency`.
    """

    rest: NDArray[np.float64]
    stiffness: NDArray[np.float64]

    def gradient(self, points: NDArray[np.float64], adjacency: NodeAdjacency) -> tuple[float, NDArray[np.float64]]:
        """The term and its gradient K v (f, d) at the free nodes' points (f, d)."""
        pull = np.empty_like(self.rest)
        energy = _multiply(adjacency.row_starts, adjacency.columns, self.stiffness, points - self.rest, pull)
        return 0.5 * float(energy), pull


@dataclass(frozen=True, eq=False)
class Descent:
    """Result of :func:`newton`: points (l, d), distortion E and quadratic term together, iterations made, measure."""

    points: NDArray[np.float64]
    distortion: float
    iterations: int
    measure: RegionMeasure


def newton(
    points: NDArray[np.float64],
    region: FreeRegion,
    norm: PNorm,
    *,
    iterations: int = 12,
    good_enough: Callable[[NDArray[np.float64]], bool] | None = None,
    solve: StepSolver | None = None,
    quadratic: QuadraticTerm | None = None,
    accuracy: Accuracy | None = None,
    constraint: RegionConstraint | None = None,
    earlier: RegionMeasure | None = None,
) -> Descent:
    """Lower E from the points (l, d) of the region; the nodes that are not free stay, bit by bit.

    Parameters
    ----------
    points : (l, d) array, mesh length unit
    region : FreeRegion
    norm : PNorm
    iterations : int
        At most so many.
    good_enough : callable, optional
        Asked with the points after every second iteration; true stops.
    solve : StepSolver, optional
        Gives the step; by default every free node moves on its own.
    quadratic : QuadraticTerm, optional
        Added to E.
    accuracy : Accuracy, optional
    constraint : RegionConstraint, optional
        Of free nodes that slide, or move alike; the points have to be admissible.
    earlier : RegionMeasure, optional
        Of the same region's last descent, which goes on from its curvature where that matters little.
    """
    accuracy = accuracy or Accuracy()
    objective = _Objective(region, region_measure(region, norm, earlier), quadratic)
    energy, weights = objective(points)
    done = 0
    while done < iterations and math.isfinite(energy):
        gradient = objective.gradient(points, weights)
        hessian = objective.measure.hessian(points, weights, refresh=accuracy.refresh, floor=accuracy.floor)
        if quadratic is not None:
            hessian = hessian + quadratic.stiffness
        solver = solve or partial(_solve, accuracy=accuracy, untangling=norm.epsilon > 0.0)
        if constraint is None:
            step = solver(region.adjacency, hessian, -gradient)
        else:
            step = constraint.step(points, hessian, -gradient, solver)
        slope = float(np.vdot(gradient, step))
        found = _line_search(points, objective, step, energy, slope, constraint)
        if found is None:
            break
        length, points, lower, weights = found
        gain, energy, done = energy - lower, lower, done + 1
        converged = length == 1.0 and gain < accuracy.full_step_gain
        if converged or -slope < accuracy.least_decrement or gain < accuracy.least_gain:
            break
        if good_enough is not None and done % 2 == 0 and good_enough(points):
            break
    return Descent(points, energy, done, objective.measure)


@dataclass(frozen=True, eq=False)
class _Objective:
    """What is lowered: the distortion of a region, and the quadratic term."""

    region: FreeRegion
    measure: RegionMeasure
    quadratic: QuadraticTerm | None

    def __call__(self, points: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """The objective at the points (l, d), and the weights of what is measured."""
        energy, weights = self.measure.mean(points)
        if self.quadratic is not None and math.isfinite(energy):
            energy += self.quadratic.gradient(points[: self.region.n_free], self.region.adjacency)[0]
        return energy, weights

    def gradient(self, points: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Its gradient (f, d)."""
        gradient = self.measure.gradient(points, weights)
        if self.quadratic is not None:
            gradient += self.quadratic.gradient(points[: self.region.n_free], self.region.adjacency)[1]
        return gradient


def _line_search(
    points: NDArray[np.float64],
    objective: _Objective,
    step: NDArray[np.float64],
    energy: float,
    slope: float,
    constraint: RegionConstraint | None,
) -> tuple[float, NDArray[np.float64], float, NDArray[np.float64]] | None:
    """Halve the step (f, d) until Armijo's rule holds: (length, points, E, w), or None if no step is left."""
    if not slope < 0.0:
        return None
    length = 1.0
    for _ in range(_HALVINGS + 1):
        trial = points.copy()
        trial[: len(step)] += length * step
        admitted = trial if constraint is None else constraint.retract(points, trial)
        if admitted is not None:
            lower, weights = objective(admitted)
            if lower <= energy + _ARMIJO * length * slope:
                return length, admitted, lower, weights
        length *= 0.5
    return None


def _solve(
    adjacency: NodeAdjacency,
    hessian: NDArray[np.float64],
    right: NDArray[np.float64],
    accuracy: Accuracy,
    *,
    untangling: bool,
) -> NDArray[np.float64]:
    """The step (f, d) of H (b, d, d) dx = right (f, d)."""
    if right.size <= (_UNTANGLING_DIRECT if untangling else accuracy.direct_unknowns):
        matrix = bsr_matrix((hessian, adjacency.columns, adjacency.row_starts), shape=(right.size, right.size))
        try:
            factor = splu(
                matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
            )
            return np.asarray(factor.solve(right.ravel())).reshape(right.shape)
        except RuntimeError:  # exactly singular: conjugate gradients stay in the range of H
            pass
    step = np.zeros_like(right)
    reduction, most = _UNTANGLING_CG if untangling else (accuracy.cg_reduction, accuracy.cg_iterations)
    with threads_for(len(adjacency.columns) // _BLOCKS_PER_THREAD):
        _conjugate_gradients(adjacency.row_starts, adjacency.columns, hessian, right, reduction, most, step)
    return step


@njit(cache=True, error_model="numpy", parallel=True)
def _invert_diagonal(row_starts, blocks, out):  # type: ignore[no-untyped-def]
    """out (f, d, d) = inverse of each row's first block, which is the diagonal's."""
    for i in prange(len(out)):
        a = blocks[row_starts[i]]
        if a.shape[0] == 1:
            out[i, 0, 0] = 1.0 / a[0, 0]
        elif a.shape[0] == 2:
            det = a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
            out[i, 0, 0], out[i, 1, 1] = a[1, 1] / det, a[0, 0] / det
            out[i, 0, 1], out[i, 1, 0] = -a[0, 1] / det, -a[1, 0] / det
        else:
            det = 0.0
            for k in range(3):
                k1, k2 = (k + 1) % 3, (k + 2) % 3
                for r in range(3):
                    r1, r2 = (r + 1) % 3, (r + 2) % 3
                    out[i, k, r] = a[r1, k1] * a[r2, k2] - a[r1, k2] * a[r2, k1]
                det += a[0, k] * out[i, k, 0]
            for k in range(3):
                for r in range(3):
                    out[i, k, r] /= det


@njit(cache=True, error_model="numpy", parallel=True)
def _precondition(inverse, residual, out):  # type: ignore[no-untyped-def]
    """out (f, d) = inverse · residual; returns residual · out in fixed blocks."""
    n, d = residual.shape
    n_blocks = (n + _ROWS - 1) // _ROWS
    partial = np.empty(n_blocks)
    for block in prange(n_blocks):
        s = 0.0
        for i in range(block * _ROWS, min(n, (block + 1) * _ROWS)):
            for r in range(d):
                t = 0.0
                for k in range(d):
                    t += inverse[i, r, k] * residual[i, k]
                out[i, r] = t
                s += t * residual[i, r]
        partial[block] = s
    return _total(partial)


@njit(cache=True, error_model="numpy", parallel=True)
def _multiply(row_starts, columns, blocks, x, out):  # type: ignore[no-untyped-def]
    """out (f, d) = H x; returns x · out in fixed blocks."""
    n, d = x.shape
    n_blocks = (n + _ROWS - 1) // _ROWS
    partial = np.empty(n_blocks)
    for block in prange(n_blocks):
        s = 0.0
        for i in range(block * _ROWS, min(n, (block + 1) * _ROWS)):
            if d == 3:
                a, b, c = 0.0, 0.0, 0.0
                for e in range(row_starts[i], row_starts[i + 1]):
                    j = columns[e]
                    u, v, w = x[j, 0], x[j, 1], x[j, 2]
                    a += blocks[e, 0, 0] * u + blocks[e, 0, 1] * v + blocks[e, 0, 2] * w
                    b += blocks[e, 1, 0] * u + blocks[e, 1, 1] * v + blocks[e, 1, 2] * w
                    c += blocks[e, 2, 0] * u + blocks[e, 2, 1] * v + blocks[e, 2, 2] * w
                out[i, 0], out[i, 1], out[i, 2] = a, b, c
                s += a * x[i, 0] + b * x[i, 1] + c * x[i, 2]
            elif d == 2:
                a, b = 0.0, 0.0
                for e in range(row_starts[i], row_starts[i + 1]):
                    j = columns[e]
                    a += blocks[e, 0, 0] * x[j, 0] + blocks[e, 0, 1] * x[j, 1]
                    b += blocks[e, 1, 0] * x[j, 0] + blocks[e, 1, 1] * x[j, 1]
                out[i, 0], out[i, 1] = a, b
                s += a * x[i, 0] + b * x[i, 1]
            else:
                a = 0.0
                for e in range(row_starts[i], row_starts[i + 1]):
                    a += blocks[e, 0, 0] * x[columns[e], 0]
                out[i, 0] = a
                s += a * x[i, 0]
        partial[block] = s
    return _total(partial)


@njit(cache=True, error_model="numpy")
def _total(partial):  # type: ignore[no-untyped-def]
    """Sum in order."""
    s = 0.0
    for value in partial:
        s += value
    return s


@njit(cache=True, error_model="numpy", parallel=True)
def _advance(alpha, p, hp, x, r):  # type: ignore[no-untyped-def]
    """x += α p, r −= α H p."""
    for i in prange(len(x)):
        for k in range(x.shape[1]):
            x[i, k] += alpha * p[i, k]
            r[i, k] -= alpha * hp[i, k]


@njit(cache=True, error_model="numpy", parallel=True)
def _turn(beta, z, p):  # type: ignore[no-untyped-def]
    """p = z + β p."""
    for i in prange(len(p)):
        for k in range(p.shape[1]):
            p[i, k] = z[i, k] + beta * p[i, k]


@njit(cache=True, error_model="numpy")
def _conjugate_gradients(  # type: ignore[no-untyped-def]
    row_starts, columns, blocks, right, tolerance, most, x
):
    """x (f, d) from 0, until the preconditioned residual has fallen by the tolerance or the curvature is lost."""
    inverse = np.empty((len(right), right.shape[1], right.shape[1]))
    _invert_diagonal(row_starts, blocks, inverse)
    residual = right.copy()
    z, hp = np.empty_like(right), np.empty_like(right)
    rho = _precondition(inverse, residual, z)
    p = z.copy()
    stop = tolerance * tolerance * rho
    for _ in range(most):
        curvature = _multiply(row_starts, columns, blocks, p, hp)
        if not curvature > 0.0:
            return
        _advance(rho / curvature, p, hp, x, residual)
        previous, rho = rho, _precondition(inverse, residual, z)
        if not rho > stop:
            return
        _turn(rho / previous, z, p)
