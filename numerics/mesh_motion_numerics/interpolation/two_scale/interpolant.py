"""An interpolant in two scales: a coarse field, and compact levels near the surfaces."""

from dataclasses import dataclass

from mesh_motion_numerics.interpolation.interpolant import Interpolant
from mesh_motion_numerics.interpolation.two_scale.nested_grid import NestedSpline


@dataclass(frozen=True, eq=False)
class TwoScaleInterpolant:
    """``S(x) = coarse(x) + Σ_l Σ_j a_lj φ(|x − x_j| / R_l)``, for k components."""

    #: With many control points a spline through the coarse interpolation, with few the coarse interpolation itself.
    coarse: NestedSpline | Interpolant
    levels: tuple[Interpolant, ...]  # Compact, widest first


AnyInterpolant = Interpolant | TwoScaleInterpolant
"""The interpolants that :mod:`..evaluation` accepts."""
