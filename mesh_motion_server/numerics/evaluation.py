"""Evaluation of an interpolant and its gradient at many points, behind one small interface.

:class:`LocalEvaluator` sums over centres on the threads of this machine. Whatever else can give the same two arrays (a
far-field grid, workers of an engine that hold the points) is an :class:`Evaluator` too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.centres import padded
from mesh_motion_server.numerics.kernels import require_gradient
from mesh_motion_server.numerics.summation import sum_gradients, sum_values
from mesh_motion_server.numerics.threads import checked_threads

if TYPE_CHECKING:
    from mesh_motion_server.numerics.interpolant import Interpolant

__all__ = ["Evaluator", "LocalEvaluator"]


class Evaluator(Protocol):
    """Gives an interpolant's values and gradients at points."""

    def displacement(self, interpolant: Interpolant, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, k) values at (n, d) points."""
        ...

    def gradient(self, interpolant: Interpolant, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, k, d) gradients ``[i, c, m] = ∂u_c/∂x_m`` at (n, d) points."""
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

    def displacement(self, interpolant: Interpolant, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, k) values at (n, d) points, thesis (2.5).

        Raises
        ------
        InvalidInput
            If the points' dimension is not the interpolant's.
        """
        out = np.empty((len(points), interpolant.weights.shape[1]))
        self._sum(sum_values, interpolant, points, out)
        if interpolant.polynomial is not None:
            out += interpolant.polynomial(points)
        return out

    def gradient(self, interpolant: Interpolant, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, k, d) gradients ``[i, c, m] = ∂u_c/∂x_m`` at (n, d) points.

        Raises
        ------
        InvalidInput
            If the basis has no gradient at its centres, or the points' dimension is not the interpolant's.
        """
        require_gradient(interpolant.basis)
        out = np.empty((len(points), interpolant.weights.shape[1], interpolant.dimension))
        self._sum(sum_gradients, interpolant, points, out)
        if interpolant.polynomial is not None:
            out += interpolant.polynomial.gradient
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
