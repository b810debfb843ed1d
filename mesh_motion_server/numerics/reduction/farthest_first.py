"""The farthest-first order of points: each next one is the one farthest from all before it.

Every prefix of the order is well separated: no two of its points are closer than the separation of the last of them,
and no point of the whole set is farther than that from the prefix (a 2-approximation of the best covering; T. F.
Gonzalez, Theoret. Comput. Sci. 38 (1985) 293–306). The nested, well separated subsets of Floater and Iske and the order
of Kedward's refinement points are prefixes of it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mesh_motion_server.numerics.centres import padded

__all__ = ["FarthestFirst", "farthest_first"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


class FarthestFirst(NamedTuple):
    """Points by decreasing separation.

    Attributes
    ----------
    order : (n,) int64 array
        Point at each rank.
    separation : (n,) array, mesh length unit
        Distance of the point at each rank from the nearest one before it, never increasing after the given points; the
        first one's is infinite.
    """

    order: Indices
    separation: Floats


def farthest_first(points: Floats, given: Indices) -> FarthestFirst:
    """Order points after some that are given.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    given : (g,) int64 array
        At least one point; they come first, in their order.

    Notes
    -----
    Ties go to the lower number. O(n²) time and O(n) memory: 0.2 s for 18 000 points.
    """
    order = np.empty(len(points), dtype=np.int64)
    order[: len(given)] = given
    separation = np.empty(len(points))
    _traverse(padded(points), len(given), order, separation)
    return FarthestFirst(order, separation)


@njit(cache=True, error_model="numpy")
def _traverse(points: Floats, given: int, order: Indices, separation: Floats) -> None:
    """Fill ``order`` (n), of which the first entries are given, and ``separation`` (n).

    The points not yet taken are kept packed, with their squared distances from those that are.
    """
    n = len(points)
    left = points.copy()
    number = np.arange(n)
    place = np.arange(n)  # of a point among those left
    nearest = np.full(n, np.inf)
    for rank in range(n):
        if rank >= given:
            order[rank] = number[_farthest(nearest[: n - rank], number)]
        at = place[order[rank]]
        separation[rank] = np.sqrt(nearest[at])
        x, y, z = left[at, 0], left[at, 1], left[at, 2]
        last = n - rank - 1  # which moves into the gap
        left[at], number[at], nearest[at] = left[last], number[last], nearest[last]
        place[number[at]] = at
        for i in range(last):
            dx, dy, dz = left[i, 0] - x, left[i, 1] - y, left[i, 2] - z
            nearest[i] = min(nearest[i], dx * dx + dy * dy + dz * dz)


@njit(cache=True, error_model="numpy")
def _farthest(nearest: Floats, number: Indices) -> int:
    """Place of the largest of ``nearest`` (m); the lowest number among equals."""
    best = 0
    for i in range(1, len(nearest)):
        if nearest[i] > nearest[best] or (nearest[i] == nearest[best] and number[i] < number[best]):
            best = i
    return best
