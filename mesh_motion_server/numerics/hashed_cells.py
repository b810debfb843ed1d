"""Points sorted by the cells of a grid of which only the cells that hold a point are stored.

Where the cells are far smaller than the domain, as about a small body in a wide one, a grid with all its cells would
not fit into memory, and one with larger cells would find thousands of points that are not near.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["MAX_HASHED_RUNS", "HashedCells", "hashed_runs"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Cells around a place.
MAX_HASHED_RUNS = 27
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
    starts : (cells + 1,) int64 array
        First sorted point of each stored cell.
    keys, cells : (t,) int64 arrays
        A table of the stored cells by their place in the grid, −1 where it is free; t is a power of two.
    """

    order: Integers
    coordinates: Array
    origin: Array
    inverse_side: float
    starts: Integers
    keys: Integers
    cells: Integers

    @classmethod
    def build(cls, points: Array, side: float) -> HashedCells:
        """Sort points (n, 3) by cells of the given side, or wider ones where there would be a million along an axis."""
        origin = points.min(axis=0)
        side = max(side, float(np.max(points.max(axis=0) - origin)) / (_MOST - 2))
        places = np.floor((points - origin) / side).astype(np.int64)
        packed = _packed(places[:, 0], places[:, 1], places[:, 2])
        order = np.argsort(packed, kind="stable")
        stored, first = np.unique(packed[order], return_index=True)
        keys = np.full(1 << (2 * len(stored)).bit_length(), -1, dtype=np.int64)
        cells = np.empty_like(keys)
        _store(stored, keys, cells)
        starts = np.append(first, len(points)).astype(np.int64)
        return cls(order, np.ascontiguousarray(points[order].T), origin, 1.0 / side, starts, keys, cells)


@njit(cache=True, error_model="numpy", inline="always")
def _packed(x, y, z):  # type: ignore[no-untyped-def]
    """One number of a cell's place."""
    return (z << (2 * _BITS)) | (y << _BITS) | x


@njit(cache=True, error_model="numpy", inline="always")
def _slot(key, mask):  # type: ignore[no-untyped-def]
    """Where a key's search begins."""
    return np.int64((np.uint64(key) * _GOLDEN) >> np.uint64(32)) & mask


@njit(cache=True, error_model="numpy")
def _store(stored: Integers, keys: Integers, cells: Integers) -> None:
    """Fill the table."""
    mask = len(keys) - 1
    for cell in range(len(stored)):
        slot = _slot(stored[cell], mask)
        while keys[slot] >= 0:
            slot = (slot + 1) & mask
        keys[slot], cells[slot] = stored[cell], cell


@njit(cache=True, error_model="numpy")
def hashed_runs(x, y, z, origin, inverse_side, starts, keys, cells, runs):  # type: ignore[no-untyped-def]
    """Fill ``runs`` (MAX_HASHED_RUNS, 2) with [first, last) of the sorted points about a place; the count."""
    px, py, pz = (x - origin[0]) * inverse_side, (y - origin[1]) * inverse_side, (z - origin[2]) * inverse_side
    if not (-1.0 <= px < _MOST and -1.0 <= py < _MOST and -1.0 <= pz < _MOST):
        return 0
    cx, cy, cz, mask, count = math.floor(px), math.floor(py), math.floor(pz), len(keys) - 1, 0
    for iz in range(max(cz - 1, 0), min(cz + 2, _MOST)):
        for iy in range(max(cy - 1, 0), min(cy + 2, _MOST)):
            for ix in range(max(cx - 1, 0), min(cx + 2, _MOST)):
                key = _packed(ix, iy, iz)
                slot = _slot(key, mask)
                while keys[slot] >= 0 and keys[slot] != key:
                    slot = (slot + 1) & mask
                if keys[slot] == key:
                    runs[count, 0], runs[count, 1] = starts[cells[slot]], starts[cells[slot] + 1]
                    count += 1
    return count
