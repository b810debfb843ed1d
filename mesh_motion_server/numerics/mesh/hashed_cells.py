"""Points sorted by the cells of a grid of which only the cells next to a point are stored.

Where the cells are far smaller than the domain, as about a small body in a wide one, a grid with all its cells would
not fit into memory, and one with larger cells would find thousands of points that are not near. A stored cell knows the
points of all 27 around it: one look finds them, or that there are none.
"""

from __future__ import annotations

from dataclasses import dataclass

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

__all__ = ["HashedCells"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Shorts = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class HashedCells:
    """Sorted points and the table that finds those of a cell.

    Attributes
    ----------
    order : (n,) int64 array
        Row ``j`` of the sorted arrays is point ``order[j]``.
    coordinates : (3, n) array
    origin : (3,) array
    inverse_side : float
    keys : (t,) int64 array
        A table of the stored cells by their place in the grid, −1 where it is free; t is a power of two. On a surface
        about a third of it is taken.
    spans : (t, 2) int32 array
        [first, last) of each cell's runs.
    runs : (r, 2) int32 array
        [first, last) of sorted points.
    """

    order: Integers
    coordinates: Array
    origin: Array
    inverse_side: float
    keys: Integers
    spans: Shorts
    runs: Shorts

    @classmethod
    def build(cls, points: Array, side: float) -> HashedCells:
        """Sort points (n, 3) by cells of the given side, or wider ones where there would be a million along an axis."""
        return cls(*kernels.store_cells(points, side))
