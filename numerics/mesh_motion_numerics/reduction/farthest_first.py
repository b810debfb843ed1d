"""The farthest-first order of points: each next one is the one farthest from all before it.

Every prefix of the order is well separated: no two of its points are closer than the separation of the last of them,
and no point of the whole set is farther than that from the prefix (a 2-approximation of the best covering; T. F.
Gonzalez, Theoret. Comput. Sci. 38 (1985) 293–306). The nested, well separated subsets of Floater and Iske and the order
of Kedward's refinement points are prefixes of it.
"""

from typing import NamedTuple

import mesh_motion_kernels as kernels

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.points import padded

__all__ = ["FarthestFirst", "farthest_first"]


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
    Ties go to the lower number. O(n²) time and O(n) memory: 0.2 s for 18 000 points.
    """
    return FarthestFirst(*kernels.farthest_first(padded(points), given))
