"""An interpolant in two scales."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.interpolant import Interpolant
from mesh_motion_server.numerics.kernels import Basis
from mesh_motion_server.numerics.two_scale.nested_grid import NestedSpline

__all__ = ["AnyInterpolant", "TwoScaleInterpolant"]


@dataclass(frozen=True, eq=False)
class TwoScaleInterpolant:
    """``S(x) = spline(x) + Σ_l Σ_j a_lj φ(|x − x_j| / R_l)``, for k components.

    Attributes
    ----------
    spline : NestedSpline
        The coarse field.
    levels : tuple of Interpolant
        Compact, widest first.
    basis : Basis
        Of the coarse field.
    iterations : int
        Of the conjugate gradients, all levels together.
    """

    spline: NestedSpline
    levels: tuple[Interpolant, ...]
    basis: Basis
    iterations: int

    @property
    def weights(self) -> NDArray[np.float64]:
        """(n, k) weights of the last level, which has all control points."""
        return self.levels[-1].weights

    @property
    def dimension(self) -> int:
        """Space dimension d."""
        return self.spline.dimension


AnyInterpolant = Interpolant | TwoScaleInterpolant
"""What an evaluator takes."""
