"""An evaluator that takes far centres together, within a tolerance of the direct sum."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.interpolation.evaluation import LocalEvaluator, Prepared
from mesh_motion_server.numerics.interpolation.far_field.far_sum import FarSum
from mesh_motion_server.numerics.interpolation.interpolant import Interpolant
from mesh_motion_server.numerics.interpolation.two_scale.interpolant import AnyInterpolant

__all__ = ["FarFieldEvaluator"]

#: Basis functions in a direct sum (a few milliseconds) below which nothing else is tried …
_SMALL = 4e6
#: … and the share of them that another one may cost.
_WORTHWHILE = 0.8


class FarFieldEvaluator(LocalEvaluator):
    """Sums that may differ from the direct ones by a share of the largest displacement that an interpolant stands for.

    An interpolant that does not know that displacement, one in two scales, and gradients are evaluated as by a
    :class:`LocalEvaluator`, and so is every sum that is as fast directly.

    The value at a point depends, within the tolerance, on the points that are evaluated with it: they share boxes. It
    does not depend on the number of threads.

    Parameters
    ----------
    tolerance : float
    threads : int, optional
        At most as many as are available, which is the default.
    """

    def __init__(self, tolerance: float, threads: int | None = None) -> None:
        super().__init__(threads)
        self._tolerance = tolerance

    def displacement(
        self, interpolant: AnyInterpolant, points: NDArray[np.float64], prepared: Prepared | None = None
    ) -> NDArray[np.float64]:
        """(n, k) values at (n, d) points, thesis (2.5), within the tolerance; of two scales exactly, as ``prepared``.

        Raises
        ------
        InvalidInput
            If the points' dimension is not the interpolant's.
        """
        far = self._planned(interpolant, points)
        if far is None:
            return super().displacement(interpolant, points, prepared)
        out = far.values(threads=self._threads)
        if far.interpolant.polynomial is not None:
            out += far.interpolant.polynomial(points)
        return out

    def _planned(self, interpolant: AnyInterpolant, points: NDArray[np.float64]) -> FarSum | None:
        """The sum, where it is worth its while and the interpolant says how good it has to be."""
        if type(interpolant) is not Interpolant or points.shape[1:] != (interpolant.dimension,):
            return None
        small = len(points) * interpolant.layout.n_centres < _SMALL
        if small or interpolant.largest == 0.0 or not np.isfinite(points).all():
            return None
        far = FarSum.build(interpolant, points, tolerance=self._tolerance * interpolant.largest)
        return far if far.work < _WORTHWHILE * far.direct_work else None
