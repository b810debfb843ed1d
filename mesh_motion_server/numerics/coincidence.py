"""Finding points that coincide."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

__all__ = ["first_coincident_pair"]

# rounding of coordinates that were written as text with 12 digits or transformed, relative to the extent
_SAME_PLACE = 1e-12
_TINY = np.finfo(np.float64).tiny


def first_coincident_pair(points: NDArray[np.float64], extent: float) -> tuple[int, int] | None:
    """Two points closer to each other than 10⁻¹² of an extent.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    extent : float, mesh length unit

    Returns
    -------
    (int, int) or None
        The pair with the lowest first number, that one first.
    """
    if len(points) < 2:
        return None
    exact = _identical(points)
    if exact is not None:
        return exact
    # distinct points only from here on: a tree over many identical ones would take quadratic time
    limit = _SAME_PLACE * extent
    # nothing is looked for further away than twice the limit, which is most of the search
    distance, neighbour = cKDTree(points).query(points, k=2, distance_upper_bound=max(2 * limit, _TINY))
    close = np.flatnonzero(distance[:, 1] <= limit)
    if not len(close):
        return None
    first = int(close[0])
    return first, int(neighbour[first, neighbour[first] != first][0])


def _identical(points: NDArray[np.float64]) -> tuple[int, int] | None:
    """As above for points with equal coordinates."""
    order = np.lexsort(points.T)
    same = np.flatnonzero((points[order[1:]] == points[order[:-1]]).all(axis=1))
    if not len(same):
        return None
    pairs = np.sort(np.column_stack([order[same], order[same + 1]]), axis=1)
    first = pairs[np.lexsort(pairs.T[::-1])[0]]
    return int(first[0]), int(first[1])
