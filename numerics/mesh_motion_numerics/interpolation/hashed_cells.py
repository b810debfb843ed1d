"""Points sorted by the cells of a grid that stores only the cells next to a point.

If the cells are far smaller than the domain, as around a small body in a large domain, a grid with all its cells would
not fit into memory, and one with larger cells would find thousands of points that are not near. A stored cell lists the
points of all 27 cells around it: one lookup finds them, or finds none.
"""

from __future__ import annotations

from dataclasses import dataclass

import mesh_motion_kernels as kernels

from mesh_motion_numerics.arrays import Floats, Integers, Shorts


@dataclass(frozen=True, eq=False)
class HashedCells:
    """Sorted points and the table that finds the points of a cell."""

    order: Integers  # (n,). Row ``j`` of the sorted arrays is point ``order[j]``
    coordinates: Floats  # (3, n)
    origin: Floats  # (3,)
    inverse_side: float
    #: (t,). A hash table of the stored cells by their place in the grid, −1 in free entries; t is a power of two. For
    #: points on a surface about a third of it is used.
    keys: Integers
    spans: Shorts  # (t, 2) int32. [first, last) of each cell's runs
    runs: Shorts  # (r, 2) int32. [first, last) of sorted points

    @classmethod
    def build(cls, points: Floats, origin: Floats, extent: float, side: float) -> HashedCells:
        """Sort points (n, 3) by cells of the given side; by wider cells if an axis would have a million of them.

        The points may be a part of all points, which reach from the ``origin`` (3,) at most ``extent`` along each axis.
        """
        return cls(*kernels.store_cells(points, origin, extent, side))
