"""Corrections of a cell's deformation by its stretches: polar, singular value and QR, and Algorithm 1's eigenvalues.

As in Algorithm 1 a stretch ≤ 0 becomes +0.1; if all are positive, the smallest increases by 0.1. The methods differ in
the definition of the stretches and in the parts that they keep:

==========  ============  ===========================================================================================
function    B =           what becomes of it
==========  ============  ===========================================================================================
``polar``   Q S (5.10)    the rotation Q is kept, the principal stretches of S are clamped
``svd``     U s Vᵀ (5.8)  as polar, and in a valid cell the largest stretch loses 0.1: §5.3.1's "reducing the ratio
                          between the two scaling factors", applied at both ends
``qr``      Q R (5.9)     the rotation and the shears are kept, the diagonal of R is clamped; depends on the coordinates
==========  ============  ===========================================================================================

The polar correction is identical to clamping the stretches of the singular value decomposition, because
``Q = U Vᵀ`` and ``S = V diag(s) Vᵀ``. All rotations are proper, so an inverted cell has one negative stretch. Unlike
eigenvalues, stretches are always real and their directions orthogonal: dJ is never larger than the stretches require.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from mesh_motion_numerics.correction.enrichment.eigen_correction import INCREMENT, eigen_correction
from numpy.typing import NDArray

from docs.studies.thesis._decompositions import deformation, qr, svd

__all__ = ["CELL_CORRECTIONS", "polar_correction", "qr_correction", "svd_correction"]

Floats = NDArray[np.float64]


def polar_correction(gradient: Floats) -> Floats:
    """Change dJ of a displacement gradient J (d, d) by its polar stretch: rotation kept, stretch clamped."""
    left, stretches, right = (part[0] for part in svd(deformation(gradient)[None]))
    return np.asarray(left * _gains(stretches) @ right.T)


def svd_correction(gradient: Floats) -> Floats:
    """Change dJ of a displacement gradient J (d, d) that brings its principal stretches together."""
    left, stretches, right = (part[0] for part in svd(deformation(gradient)[None]))
    gains = _gains(stretches)
    if (stretches > 0.0).all() and stretches[0] > stretches[-1] + 2.0 * INCREMENT:  # the order must not change
        gains[0] -= INCREMENT
    return np.asarray(left * gains @ right.T)


def qr_correction(gradient: Floats) -> Floats:
    """Change dJ of a displacement gradient J (d, d) by the diagonal of R: rotation and shears kept."""
    rotation, triangle = (part[0] for part in qr(deformation(gradient)[None]))
    return np.asarray(rotation * _gains(np.diagonal(triangle)))


def _gains(stretches: Floats) -> Floats:
    """Increase of each stretch (d,): a stretch ≤ 0 becomes the increment, else the smallest increases by it."""
    gains = np.where(stretches <= 0.0, INCREMENT - stretches, 0.0)
    if not gains.any():
        gains[np.argmin(stretches)] = INCREMENT
    return np.asarray(gains)


CELL_CORRECTIONS: dict[str, Callable[[Floats], Floats]] = {
    "eigen": eigen_correction,
    "polar": polar_correction,
    "svd": svd_correction,
    "qr": qr_correction,
}
"""Change dJ (d, d) of a displacement gradient (d, d), by the decomposition of B = I + J that it looks at."""
