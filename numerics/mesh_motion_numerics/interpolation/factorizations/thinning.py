"""An order of points from coarse to fine: each prefix covers the whole set about evenly.

Nested thinning by grids whose cells halve: a level takes the first point of every cell that contains none yet.
Deterministic, O(n log n) per level; the number of levels is the range of the points' spacings in powers of two.
"""

import numpy as np
from scipy.spatial import cKDTree

from mesh_motion_numerics.arrays import Floats, Integers

#: Spacings down to 2⁻⁴⁸ of the extent; closer points count as one level, in their own order.
_MAX_LEVELS = 48


def nested_levels(points: Floats) -> list[Integers]:
    """Indices of (n, d) distinct points, level by level."""
    low = points.min(axis=0)
    extent = max(float(np.max(points.max(axis=0) - low)), np.finfo(float).tiny)
    remaining = np.arange(len(points))
    taken = np.empty(0, dtype=np.int64)
    levels: list[Integers] = []
    for level in range(_MAX_LEVELS):
        cells = np.floor((points - low) * (2.0**level / extent)).astype(np.int64)
        keys = _hash(cells)
        free = remaining[~np.isin(keys[remaining], keys[taken])]
        _, first = np.unique(keys[free], return_index=True)
        chosen = np.sort(free[first])
        if chosen.size:
            levels.append(chosen)
            taken = np.concatenate([taken, chosen])
            remaining = np.setdiff1d(remaining, chosen, assume_unique=True)
        if not remaining.size:
            return levels
    return [*levels, remaining]


def _hash(cells: Integers) -> Integers:
    """One number per cell; a collision only moves a point to a finer level."""
    factors = np.array([73856093, 19349663, 83492791], dtype=np.int64)[: cells.shape[1]]
    with np.errstate(over="ignore"):
        keys: Integers = np.bitwise_xor.reduce(cells * factors, axis=1)
    return keys


def nearest_preceding(points: Floats, levels: list[Integers], count: int) -> tuple[Integers, Integers]:
    """For every point in the order of the levels, up to ``count`` near points that come before it.

    Returns
    -------
    order : (n,) int64 array
        Point at each rank.
    neighbours : (n, count) int64 array
        Ranks, nearest first; −1 for missing points.
    """
    order = np.concatenate(levels)
    n = len(order)
    sorted_points = points[order]
    neighbours = np.full((n, count), -1, dtype=np.int64)
    first = 0
    for level in levels:
        last = first + len(level)
        # The later points of a level are skipped: search for twice as many as are kept.
        asked = min(2 * count + 1, last)
        found = cKDTree(sorted_points[:last]).query(sorted_points[first:last], k=np.arange(1, asked + 1))[1]
        _keep_preceding(found, np.arange(first, last), neighbours[first:last])
        first = last
    return order, neighbours


def _keep_preceding(found: Integers, ranks: Integers, out: Integers) -> None:
    """Move the entries smaller than the row's rank to the front, in their order, as many as there is room for."""
    precedes = found < ranks[:, None]
    place = np.cumsum(precedes, axis=1) - 1
    row, column = np.nonzero(precedes & (place < out.shape[1]))
    out[row, place[row, column]] = found[row, column]
