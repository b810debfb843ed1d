"""The distance between neighbouring points, and the connected parts of linked items.

It loads SciPy, unlike :mod:`.points`, which processes without it import.
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mesh_motion_numerics.arrays import Floats, Integers


def connected(count: int, ones: Integers, others: Integers) -> Integers:
    """(count,) number of the connected part to which each item belongs, if ``ones`` are linked to ``others`` (p,)."""
    links = coo_array((np.ones(len(ones)), (ones, others)), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)


def parts_of(rows: Integers, count: int) -> Integers:
    """(r,) number of the connected part of each of the rows (r, w) of ``count`` nodes; −1 is not a node."""
    ends = np.where(rows[:, 1:] >= 0, rows[:, 1:], rows[:, :1])
    starts = np.broadcast_to(rows[:, :1], ends.shape)
    labels = connected(count, starts.ravel(), ends.ravel())[rows[:, 0]]
    return np.asarray(np.unique(labels, return_inverse=True)[1], dtype=np.int64)


def local_spacing(points: Floats) -> Floats:
    """(n,) distance of each of (n, d) points to its nearest neighbour, mesh length unit; inf for a single point."""
    if len(points) < 2:
        return np.full(len(points), np.inf)
    return np.asarray(cKDTree(points).query(points, k=2)[0][:, 1])
