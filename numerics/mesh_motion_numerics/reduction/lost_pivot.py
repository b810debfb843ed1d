"""A pivot that is only rounding: its point is numerically equal to a selected one."""

import numpy as np
from mesh_motion_protocol.errors import QualityRefused

__all__ = ["LOST", "singular"]

LOST = 64 * float(np.finfo(float).eps)
"""A pivot this small against φ(0) carries no correct digit."""


def singular() -> QualityRefused:
    """The error for such a point."""
    return QualityRefused(
        "the interpolation matrix of the selected control points is singular to working precision",
        code="FAILED_PRECONDITION",
        hint="take a larger reduction_tolerance, a smaller support radius or a less smooth basis",
    )
