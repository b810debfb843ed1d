"""Points with one, two or three coordinates: padded, their bounding box, marks and samples of them."""

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats, Integers, Marks


def padded(points: Floats) -> Floats:
    """(n, 3) contiguous array of (n, d) points, not to be written to; missing coordinates are zero."""
    n, d = points.shape
    if d == 3:  # no copy if the points are contiguous: they are the largest arrays of a mesh
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


def rows_among(count: int, nodes: Integers) -> Integers:
    """(count,) row of each node in ``nodes`` (k,), −1 for the others."""
    rows = np.full(count, -1, dtype=np.int64)
    rows[nodes] = np.arange(len(nodes))
    return rows


def marks_at(count: int, *nodes: NDArray[np.integer]) -> Marks:
    """(count,) True at all of these nodes."""
    marks = np.zeros(count, dtype=bool)
    for some in nodes:
        marks[some] = True
    return marks
