"""Points sorted by the cells of a uniform grid, compiled: what finds the centres near a place.

Cells are numbered x fastest. ``centres.py`` decides on the grid and holds the arrays; the sums walk them.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

__all__ = ["count_neighbours", "mark_neighbours", "mark_reached", "sort_by_cells"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_BLOCK = 1024  # points of one task


@njit(cache=True, error_model="numpy")
def sort_by_cells(
    points: Array, origin: Array, inverse_side: float, shape: Integers, order: Integers, starts: Integers
) -> None:
    """Fill ``order`` (n,) so that ``points[order]`` (n, 3) are sorted by cells, in their own order within one.

    ``starts`` (cells + 1,), zero at first, gets the first point of each cell.
    """
    n = len(points)
    number = np.empty(n, dtype=np.int64)
    for i in range(n):
        x = min(math.floor((points[i, 0] - origin[0]) * inverse_side), shape[0] - 1)
        y = min(math.floor((points[i, 1] - origin[1]) * inverse_side), shape[1] - 1)
        z = min(math.floor((points[i, 2] - origin[2]) * inverse_side), shape[2] - 1)
        number[i] = (z * shape[1] + y) * shape[0] + x
        starts[number[i] + 1] += 1
    for cell in range(len(starts) - 1):
        starts[cell + 1] += starts[cell]
    place = starts[:-1].copy()
    for i in range(n):
        order[place[number[i]]] = i
        place[number[i]] += 1


@njit(cache=True, error_model="numpy")
def count_neighbours(starts: Integers, shape: Integers) -> int:
    """Pairs of points of which one is in the cell of the other or next to it."""
    pairs = 0
    for z in range(shape[2]):
        for y in range(shape[1]):
            for x in range(shape[0]):
                cell = (z * shape[1] + y) * shape[0] + x
                own = starts[cell + 1] - starts[cell]
                if own == 0:
                    continue
                low, high = max(x - 1, 0), min(x + 1, shape[0] - 1)
                for iz in range(max(z - 1, 0), min(z + 1, shape[2] - 1) + 1):
                    for iy in range(max(y - 1, 0), min(y + 1, shape[1] - 1) + 1):
                        row = (iz * shape[1] + iy) * shape[0]
                        pairs += own * (starts[row + high + 1] - starts[row + low])
    return pairs


@njit(cache=True, error_model="numpy")
def mark_neighbours(starts: Integers, shape: Integers, reached: NDArray[np.bool_]) -> None:
    """Mark in ``reached``, flat with a cell more on each side and false at first, cells with a point and those next."""
    nx, ny = shape[0] + 2, shape[1] + 2
    for z in range(shape[2]):
        for y in range(shape[1]):
            for x in range(shape[0]):
                cell = (z * shape[1] + y) * shape[0] + x
                if starts[cell + 1] == starts[cell]:
                    continue
                for iz in range(z, z + 3):
                    for iy in range(y, y + 3):
                        row = (iz * ny + iy) * nx + x
                        reached[row] = reached[row + 1] = reached[row + 2] = True


@njit(cache=True, error_model="numpy", parallel=True)
def mark_reached(
    points: Array,
    origin: Array,
    inverse_side: float,
    shape: Integers,
    reached: NDArray[np.bool_],
    out: NDArray[np.bool_],
) -> None:
    """``out[i]``: whether the cell of ``points[i]`` (n, d) is marked by :func:`mark_neighbours`."""
    n, d = points.shape
    nx, ny, nz = shape[0] + 2, shape[1] + 2, shape[2] + 2
    for block in prange((n + _BLOCK - 1) // _BLOCK):
        for i in range(block * _BLOCK, min(n, (block + 1) * _BLOCK)):
            # compared before they become integers: a place far away would not fit into one
            x = (points[i, 0] - origin[0]) * inverse_side + 1.0
            y = ((points[i, 1] if d > 1 else 0.0) - origin[1]) * inverse_side + 1.0
            z = ((points[i, 2] if d > 2 else 0.0) - origin[2]) * inverse_side + 1.0
            inside = 0.0 <= x < nx and 0.0 <= y < ny and 0.0 <= z < nz
            out[i] = inside and reached[(int(z) * ny + int(y)) * nx + int(x)]
