"""Evaluation of an interpolant and its gradient at many points, behind one small interface.

An interpolant in two scales is a spline and sums over few near centres; any other one is a sum over all centres.

:class:`LocalEvaluator` sums over centres on the threads of this machine. Whatever else can give the same two arrays (a
far-field grid, workers of an engine that hold the points) is an :class:`Evaluator` too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.centres import padded
from mesh_motion_server.numerics.interpolant import Interpolant
from mesh_motion_server.numerics.kernels import require_gradient
from mesh_motion_server.numerics.quality_summary import QualitySummary
from mesh_motion_server.numerics.summation import sum_gradients, sum_values
from mesh_motion_server.numerics.threads import checked_threads, threads_for
from mesh_motion_server.numerics.two_scale.interpolant import AnyInterpolant, TwoScaleInterpolant

__all__ = ["Evaluator", "Judge", "LocalEvaluator"]

#: A spline's value in evaluations of a basis function.
_SPLINE_WORK = 64.0


class Evaluator(Protocol):
    """Gives an interpolant's values and gradients at points."""

    def displacement(self, interpolant: AnyInterpolant, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, k) values at (n, d) points."""
        ...

    def gradient(self, interpolant: AnyInterpolant, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, k, d) gradients ``[i, c, m] = ∂u_c/∂x_m`` at (n, d) points."""
        ...


class Judge(Protocol):
    """Says how good a mesh is whose nodes it may already have."""

    def summary(self, points: NDArray[np.float64], metric: str) -> QualitySummary:
        """Quality of the mesh with its nodes at ``points`` (n, d), size relative to the reference mesh."""
        ...


class LocalEvaluator:
    """Direct or cell-by-cell sums in compiled threads; memory for the result only.

    The value at a point depends on the interpolant and that point alone: bitwise the same for any number of threads and
    for any way to split the points into calls.

    Parameters
    ----------
    threads : int, optional
        At most as many as numba was started with, which is the default.
    """

    def __init__(self, threads: int | None = None) -> None:
        self._threads = checked_threads(threads)

    def displacement(self, interpolant: AnyInterpolant, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, k) values at (n, d) points, thesis (2.5).

        Raises
        ------
        InvalidInput
            If the points' dimension is not the interpolant's.
        """
        out = np.empty((len(points), interpolant.weights.shape[1]))
        if isinstance(interpolant, TwoScaleInterpolant):
            values = interpolant.spline.values
            return self._in_two_scales(interpolant, points, out, spline=values, level_sum=self.displacement)
        self._sum(sum_values, interpolant, points, out)
        if interpolant.polynomial is not None:
            out += interpolant.polynomial(points)
        return out

    def gradient(self, interpolant: AnyInterpolant, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, k, d) gradients ``[i, c, m] = ∂u_c/∂x_m`` at (n, d) points.

        Raises
        ------
        InvalidInput
            If the basis has no gradient at its centres, or the points' dimension is not the interpolant's.
        """
        require_gradient(interpolant.basis)
        out = np.empty((len(points), interpolant.weights.shape[1], interpolant.dimension))
        if isinstance(interpolant, TwoScaleInterpolant):
            gradients = interpolant.spline.gradients
            return self._in_two_scales(interpolant, points, out, spline=gradients, level_sum=self.gradient)
        self._sum(sum_gradients, interpolant, points, out)
        if interpolant.polynomial is not None:
            out += interpolant.polynomial.gradient
        return out

    def _in_two_scales(
        self,
        interpolant: TwoScaleInterpolant,
        points: NDArray[np.float64],
        out: NDArray[np.float64],
        *,
        spline: Callable[[NDArray[np.float64], NDArray[np.float64]], None],
        level_sum: Callable[[Interpolant, NDArray[np.float64]], NDArray[np.float64]],
    ) -> NDArray[np.float64]:
        """The spline's values or gradients in ``out`` (n, …), and those of the compact levels where they reach."""
        places = padded(points)
        with threads_for(_SPLINE_WORK * len(points), self._threads):
            spline(places, out)
        for level in interpolant.levels:
            near = level.layout.within_reach(places, threads=self._threads)
            out[near] += level_sum(level, points[near])
        return out

    def _sum(
        self,
        kernel: Callable[..., None],
        interpolant: Interpolant,
        points: NDArray[np.float64],
        out: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Run a compiled sum over the interpolant's centres."""
        if points.ndim != 2 or points.shape[1] != interpolant.dimension:
            raise InvalidInput(
                f"expected points of shape (n, {interpolant.dimension}), got {points.shape}",
                code="INVALID_ARGUMENT.SHAPE",
            )
        weights = interpolant.layout.sort(interpolant.weights)
        return interpolant.layout.sum(
            kernel, interpolant.basis, interpolant.support_radius, padded(points), weights, out, threads=self._threads
        )
