"""Evaluation of an interpolant and its gradient at many points, behind one small interface.

:class:`LocalEvaluator` sums over centres on the threads of this machine. Whatever else can give the same two arrays (a
far-field grid, workers of an engine that hold the points) is an :class:`Evaluator` too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

import numba
import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.centres import padded
from mesh_motion_server.numerics.kernels import require_gradient
from mesh_motion_server.numerics.summation import sum_gradients, sum_values

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
        available = int(numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]  # set at run time
        if threads is not None and not 1 <= threads <= available:
            raise InvalidInput(
                f"expected 1 to {available} evaluation threads, got {threads}", hint="set NUMBA_NUM_THREADS for more"
            )
        self._threads = threads or available

    def displacement(self, interpolant: Interpolant, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, k) values at (n, d) points.

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
    ) -> None:
        """Run a compiled sum over the interpolant's centres."""
        if points.ndim != 2 or points.shape[1] != interpolant.dimension:
            raise InvalidInput(
                f"expected points of shape (n, {interpolant.dimension}), got {points.shape}",
                code="INVALID_ARGUMENT.SHAPE",
            )
        layout = interpolant.layout
        with _threads(self._threads):
            kernel(
                interpolant.basis.code,
                padded(points),
                layout.coordinates,
                layout.sort(interpolant.weights),
                1.0 / interpolant.support_radius,
                *layout.grid(),
                out,
            )


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """Limit this thread's parallel kernels, and restore."""
    before = numba.get_num_threads()
    numba.set_num_threads(count)
    try:
        yield
    finally:
        numba.set_num_threads(before)
