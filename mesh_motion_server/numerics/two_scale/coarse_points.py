"""Which control points carry the motion into the volume.

Farthest-first with distances measured in the local spacing of the boundary: the mesher put many nodes where detail
matters, so a small body in a wide domain gets as large a share of the coarse points as of the nodes, and no part of any
surface is left out.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["coarse_points"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]

_MOVING_SHARE = 0.6


def coarse_points(points: Floats, spacing: Floats, moving: Mask, count: int) -> Indices:
    """Choose up to ``count`` control points, if there are as many three moving ones to two at rest.

    The field is steepest between the moving body and what is near it; walls at rest need points only so that the field
    vanishes there.

    Parameters
    ----------
    points : (n, 3) array, mesh length unit
    spacing : (n,) array, mesh length unit
    moving : (n,) bool array
    count : int

    Returns
    -------
    (m,) int64 array
        Ascending.

    Notes
    -----
    Ties go to the lower number. O(n · count) time.
    """
    body, rest = np.flatnonzero(moving), np.flatnonzero(~moving)
    share = min(max(round(_MOVING_SHARE * count), count - len(rest)), len(body))
    chosen = [_farthest_first(points, spacing, body, share), _farthest_first(points, spacing, rest, count - share)]
    return np.sort(np.concatenate(chosen))


def _farthest_first(points: Floats, spacing: Floats, candidates: Indices, count: int) -> Indices:
    """Numbers of up to ``count`` of the candidates."""
    chosen = np.empty(min(count, len(candidates)), dtype=np.int64)
    if len(chosen) == len(candidates):
        return candidates
    _choose(points[candidates], 1.0 / spacing[candidates] ** 2, chosen)
    return candidates[chosen]


@njit(cache=True, error_model="numpy")
def _choose(points: Floats, weights: Floats, chosen: Indices) -> None:
    """Fill ``chosen``: each next point has the largest weight × squared distance from those before; first is 0."""
    nearest = np.full(len(points), np.inf)
    best = 0
    for rank in range(len(chosen)):
        chosen[rank] = best
        x, y, z = points[best, 0], points[best, 1], points[best, 2]
        best, largest = 0, -1.0
        for i in range(len(points)):
            dx, dy, dz = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
            nearest[i] = min(nearest[i], dx * dx + dy * dy + dz * dz)
            if nearest[i] * weights[i] > largest:
                best, largest = i, nearest[i] * weights[i]
