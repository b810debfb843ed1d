"""Points sorted by the cells of a grid of which only the cells next to a point are stored.

Where the cells are far smaller than the domain, as about a small body in a wide one, a grid with all its cells would
not fit into memory, and one with larger cells would find thousands of points that are not near. A stored cell knows the
points of all 27 around it: one look finds them, or that there are none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mesh_motion_kernels as kernels
import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["MAX_HASHED_RUNS", "HashedCells", "hashed_runs"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Shorts = NDArray[np.int32]

#: Cells around a place, of which neighbours along x may make one run.
_AROUND = 27
MAX_HASHED_RUNS = _AROUND
#: Bits of a cell's number along one axis, and the most cells there.
_BITS = 20
_MOST = 1 << _BITS
#: Multiplier of Fibonacci hashing: 2⁶⁴ over the golden ratio.
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


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
        origin = points.min(axis=0)
        side = max(side, float(np.max(points.max(axis=0) - origin)) / (_MOST - 4))
        places = np.floor((points - origin) / side).astype(np.int64)
        packed = _packed(places[:, 0], places[:, 1], places[:, 2])
        order = np.argsort(packed, kind="stable")
        held, first = np.unique(packed[order], return_index=True)
        keys, spans, runs = kernels.store_cells(held, np.append(first, len(points)))
        coordinates = np.ascontiguousarray(points[order].T)
        return cls(order, coordinates, origin, 1.0 / side, keys, spans, runs)


@njit(cache=True, error_model="numpy", inline="always")
def _packed(x, y, z):  # type: ignore[no-untyped-def]
    """One number of a cell's place, −1 or more along each axis."""
    return ((z + 1) << (2 * _BITS)) | ((y + 1) << _BITS) | (x + 1)


@njit(cache=True, error_model="numpy", inline="always")
def _slot(key, keys):  # type: ignore[no-untyped-def]
    """Where a key is in the table, or would be."""
    mask = len(keys) - 1
    slot = np.int64((np.uint64(key) * _GOLDEN) >> np.uint64(32)) & mask
    while keys[slot] >= 0 and keys[slot] != key:
        slot = (slot + 1) & mask
    return slot


@njit(cache=True, error_model="numpy", inline="always")
def hashed_runs(x, y, z, origin, inverse_side, keys, spans, runs, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` (MAX_HASHED_RUNS, 2) with [first, last) of the sorted points about a place; the count."""
    px, py, pz = (x - origin[0]) * inverse_side, (y - origin[1]) * inverse_side, (z - origin[2]) * inverse_side
    count = 0
    if -1.0 <= px < _MOST - 2 and -1.0 <= py < _MOST - 2 and -1.0 <= pz < _MOST - 2:
        slot = _slot(_packed(math.floor(px), math.floor(py), math.floor(pz)), keys)
        if keys[slot] >= 0:
            for run in range(spans[slot, 0], spans[slot, 1]):
                out[count, 0], out[count, 1] = runs[run, 0], runs[run, 1]
                count += 1
    return count
