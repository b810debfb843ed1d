"""The farthest-first order of points: each point is the one farthest from all earlier points.

Every prefix of the order is well separated: no two of its points are closer than the separation of the last of them,
and no point of the whole set is farther than that from the prefix (at most twice the distance of the best covering; T.
F. Gonzalez, Theoret. Comput. Sci. 38 (1985) 293–306). The nested, well separated subsets of Floater and Iske and the
order of Kedward's refinement points are prefixes of it.
"""

from typing import NamedTuple

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers

__all__ = ["FarthestFirst", "farthest_first"]


class FarthestFirst(NamedTuple):
    """Points by decreasing separation.

    Attributes
    ----------
    order : (n,) int64 array
        Point at each rank.
    separation : (n,) array, mesh length unit
        Distance of the point at each rank from the nearest earlier point. It never increases after the given points;
        for the first point it is infinite.
    """

    order: Integers
    separation: Floats


def farthest_first(points: Floats, given: Integers) -> FarthestFirst:
    """Order points after some that are given.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    given : (g,) int64 array
        At least one point; they come first, in their order.

    Notes
    -----
    Ties go to the lower number. O(n²) time and O(n) memory.
    """
    order, separation = np.empty(len(points), dtype=np.int64), np.empty(len(points))
    nearest = np.full(len(points), np.inf)  # squared distances from the points taken, −1 of those
    for rank in range(len(points)):
        node = order[rank] = given[rank] if rank < len(given) else np.argmax(nearest)
        separation[rank] = np.sqrt(nearest[node])
        distance = np.sum((points - points[node]) ** 2, axis=1)
        nearest = np.where(nearest < 0.0, -1.0, np.minimum(nearest, distance))
        nearest[node] = -1.0
    return FarthestFirst(order, separation)
