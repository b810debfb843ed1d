"""A uniform cubic B-spline on boxes, and its gradient, compiled.

Boxes lie finest first; a point belongs to the first that holds it, or if none does to the last, at whose rim it is then
taken. Coefficients stand on the grid points −1 … cells + 1 along each axis; an axis without cells has one layer.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

__all__ = ["spline_gradients", "spline_values"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_BLOCK = 256  # points of one task

# Sums may be contracted to fused operations; nothing is reassociated, so every machine adds in the same order.
_SUMS = {"contract"}


@njit(cache=True, error_model="numpy", inline="always")
def _value_weights(t, w):  # type: ignore[no-untyped-def]
    """The four B-splines at t in [0, 1]."""
    u = 1.0 - t
    w[0] = u * u * u / 6.0
    w[1] = (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0
    w[2] = (4.0 - 6.0 * u * u + 3.0 * u * u * u) / 6.0
    w[3] = t * t * t / 6.0


@njit(cache=True, error_model="numpy", inline="always")
def _slope_weights(t, w):  # type: ignore[no-untyped-def]
    """Their derivatives."""
    u = 1.0 - t
    w[0] = -0.5 * u * u
    w[1] = (-12.0 * t + 9.0 * t * t) / 6.0
    w[2] = (12.0 * u - 9.0 * u * u) / 6.0
    w[3] = 0.5 * t * t


@njit(cache=True, error_model="numpy")
def _locate(x, y, z, origin, inverse, cells, cell, t):  # type: ignore[no-untyped-def]
    """The box of a point; its cell (3,) there and the place (3,) within it."""
    last = len(origin) - 1
    for b in range(last + 1):
        px = (x - origin[b, 0]) * inverse[b]
        py = (y - origin[b, 1]) * inverse[b]
        pz = (z - origin[b, 2]) * inverse[b]
        inside = 0.0 <= px <= cells[b, 0] and 0.0 <= py <= cells[b, 1] and 0.0 <= pz <= cells[b, 2]
        if inside or b == last:
            _split(px, cells[b, 0], 0, cell, t)
            _split(py, cells[b, 1], 1, cell, t)
            _split(pz, cells[b, 2], 2, cell, t)
            return b
    return last


@njit(cache=True, error_model="numpy", inline="always")
def _split(p, n, axis, cell, t):  # type: ignore[no-untyped-def]
    """Whole and fractional part of a place in 0 … n."""
    if n == 0:
        cell[axis] = 0
        t[axis] = 0.0
        return
    p = min(max(p, 0.0), float(n))
    c = min(int(p), n - 1)
    cell[axis] = c
    t[axis] = p - c


@njit(cache=True, error_model="numpy", fastmath=_SUMS)
def _sum(cell, cells, start, w, coefficients, out):  # type: ignore[no-untyped-def]
    """``out[k] = Σ w_x w_y w_z c[k]`` over the stencil of a cell; ``w`` (3, 4)."""
    ny = cells[1] + 3 if cells[1] > 0 else 1
    nz = cells[2] + 3 if cells[2] > 0 else 1
    mx = 4 if cells[0] > 0 else 1
    my = 4 if cells[1] > 0 else 1
    mz = 4 if cells[2] > 0 else 1
    for k in range(out.size):
        out[k] = 0.0
    for i in range(mx):
        wx = w[0, i] if mx == 4 else 1.0
        for j in range(my):
            wxy = wx * w[1, j] if my == 4 else wx
            row = start + ((cell[0] + i) * ny + cell[1] + j) * nz + cell[2]
            for m in range(mz):
                weight = wxy * w[2, m] if mz == 4 else wxy
                for k in range(out.size):
                    out[k] += weight * coefficients[row + m, k]


@njit(cache=True, error_model="numpy", fastmath=_SUMS, inline="always")
def _sum_of_three(cell, cells, start, w, coefficients, out):  # type: ignore[no-untyped-def]
    """:func:`_sum` of three components in three dimensions, with the totals in registers."""
    a, b, c = 0.0, 0.0, 0.0
    ny, nz = cells[1] + 3, cells[2] + 3
    w0, w1, w2, w3 = w[2, 0], w[2, 1], w[2, 2], w[2, 3]
    for i in range(4):
        for j in range(4):
            r = start + ((cell[0] + i) * ny + cell[1] + j) * nz + cell[2]
            line = w[0, i] * w[1, j]
            q = coefficients
            a += line * (w0 * q[r, 0] + w1 * q[r + 1, 0] + w2 * q[r + 2, 0] + w3 * q[r + 3, 0])
            b += line * (w0 * q[r, 1] + w1 * q[r + 1, 1] + w2 * q[r + 2, 1] + w3 * q[r + 3, 1])
            c += line * (w0 * q[r, 2] + w1 * q[r + 1, 2] + w2 * q[r + 2, 2] + w3 * q[r + 3, 2])
    out[0], out[1], out[2] = a, b, c


@njit(cache=True, error_model="numpy", fastmath=_SUMS, inline="always")
def _sum_of_two(cell, cells, start, w, coefficients, out):  # type: ignore[no-untyped-def]
    """:func:`_sum` of two components in two dimensions."""
    a, b = 0.0, 0.0
    ny = cells[1] + 3
    w0, w1, w2, w3 = w[1, 0], w[1, 1], w[1, 2], w[1, 3]
    for i in range(4):
        r = start + (cell[0] + i) * ny + cell[1]
        q = coefficients
        a += w[0, i] * (w0 * q[r, 0] + w1 * q[r + 1, 0] + w2 * q[r + 2, 0] + w3 * q[r + 3, 0])
        b += w[0, i] * (w0 * q[r, 1] + w1 * q[r + 1, 1] + w2 * q[r + 2, 1] + w3 * q[r + 3, 1])
    out[0], out[1] = a, b


@njit(cache=True, error_model="numpy", parallel=True)
def spline_values(
    points: Floats, origin: Floats, inverse: Floats, cells: Indices, start: Indices, coefficients: Floats, out: Floats
) -> None:
    """Fill ``out`` (n, k) at (n, 3) points.

    Parameters
    ----------
    points : (n, 3) array
    origin, inverse, cells, start : (b, 3), (b,), (b, 3), (b,)
        Lower corner, 1 / spacing, cells and first coefficient of each box.
    coefficients : (c, k) array
    out : (n, k) array
    """
    n, k = out.shape
    solid = k == 3 and cells[0, 2] > 0
    plane = k == 2 and cells[0, 2] == 0 and cells[0, 1] > 0
    for block in prange((n + _BLOCK - 1) // _BLOCK):
        cell, t, w, total = np.empty(3, dtype=np.int64), np.empty(3), np.empty((3, 4)), np.empty(k)
        for i in range(block * _BLOCK, min(n, (block + 1) * _BLOCK)):
            b = _locate(points[i, 0], points[i, 1], points[i, 2], origin, inverse, cells, cell, t)
            for axis in range(3):
                _value_weights(t[axis], w[axis])
            if solid:
                _sum_of_three(cell, cells[b], start[b], w, coefficients, out[i])
                continue
            if plane:
                _sum_of_two(cell, cells[b], start[b], w, coefficients, out[i])
                continue
            _sum(cell, cells[b], start[b], w, coefficients, total)
            for c in range(k):
                out[i, c] = total[c]


@njit(cache=True, error_model="numpy", parallel=True)
def spline_gradients(
    points: Floats, origin: Floats, inverse: Floats, cells: Indices, start: Indices, coefficients: Floats, out: Floats
) -> None:
    """Fill ``out`` (n, k, d) with derivatives; arguments as in :func:`spline_values`."""
    n, k, d = out.shape
    for block in prange((n + _BLOCK - 1) // _BLOCK):
        cell, t, w, total = np.empty(3, dtype=np.int64), np.empty(3), np.empty((3, 4)), np.empty(k)
        for i in range(block * _BLOCK, min(n, (block + 1) * _BLOCK)):
            b = _locate(points[i, 0], points[i, 1], points[i, 2], origin, inverse, cells, cell, t)
            for m in range(d):
                for axis in range(3):
                    if axis == m:
                        _slope_weights(t[axis], w[axis])
                    else:
                        _value_weights(t[axis], w[axis])
                _sum(cell, cells[b], start[b], w, coefficients, total)
                for c in range(k):
                    out[i, c, m] = total[c] * inverse[b]
