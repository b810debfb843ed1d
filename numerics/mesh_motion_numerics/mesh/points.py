"""Points with one, two or three coordinates: padded, their box and spacing, marks, connected parts, samples."""

import mesh_motion_kernels as kernels
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mesh_motion_numerics.arrays import Floats, Integers, Marks

__all__ = ["bounding_box", "connected", "local_spacing", "marks_at", "padded", "spread"]


def padded(points: Floats) -> Floats:
    """(n, 3) contiguous copy of (n, d) points; missing coordinates are zero."""
    n, d = points.shape
    if d == 3:
        return np.ascontiguousarray(points, dtype=np.float64)
    out = np.zeros((n, 3))
    out[:, :d] = points
    return out


def bounding_box(points: Floats) -> Floats:
    """(2, d) lower and upper corner of (n, d) finite points, n ≥ 1."""
    corners: Floats = kernels.bounding_box(np.ascontiguousarray(points, dtype=np.float64))
    return corners


def spread(some: Integers, most: int) -> Integers:
    """At most this many of the items ``some`` (s, …), spread over them."""
    return some[np.unique(np.linspace(0, len(some) - 1, min(most, len(some))).astype(np.int64))]


def marks_at(count: int, *nodes: Integers) -> Marks:
    """(count,) True at all of these nodes."""
    marks = np.zeros(count, dtype=bool)
    for some in nodes:
        marks[some] = True
    return marks


def connected(count: int, ones: Integers, others: Integers) -> Integers:
    """(count,) number of the connected part to which each item belongs, if ``ones`` are linked to ``others`` (p,)."""
    links = coo_array((np.ones(len(ones)), (ones, others)), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)


def local_spacing(points: Floats) -> Floats:
    """(n,) distance of each of (n, d) points to its nearest neighbour, mesh length unit; inf for a single point."""
    if len(points) < 2:
        return np.full(len(points), np.inf)
    return np.asarray(cKDTree(points).query(points, k=2)[0][:, 1])
