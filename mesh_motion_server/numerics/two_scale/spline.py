"""A uniform cubic B-spline on boxes, and its gradient, compiled.

Boxes lie finest first; a point belongs to the first that holds it, or if none does to the last, at whose rim it is then
taken. Coefficients stand on the grid points −1 … cells + 1 along each axis; an axis without cells has one layer.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.numerics.vector_lanes import plane_sums, solid_sums

__all__ = ["spline_gradients", "spline_values"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_BLOCK = 256  # points of one task
_SIXTH = 1.0 / 6.0

# Sums may be contracted to fused operations; nothing is reassociated, so every machine adds in the same order.
_SUMS = {"contract"}


@njit(cache=True, error_model="numpy", inline="always")
def _four(t):  # type: ignore[no-untyped-def]
    """The four B-splines at t in [0, 1]."""
    u = 1.0 - t
    t2, u2 = t * t, u * u
    return _SIXTH * u2 * u, 4.0 * _SIXTH - t2 + 0.5 * t2 * t, 4.0 * _SIXTH - u2 + 0.5 * u2 * u, _SIXTH * t2 * t


@njit(cache=True, error_model="numpy", inline="always")
def _value_weights(t, w):  # type: ignore[no-untyped-def]
    """Fill ``w`` (4,) with them."""
    w[0], w[1], w[2], w[3] = _four(t)


@njit(cache=True, error_model="numpy", inline="always")
def _slope_weights(t, w):  # type: ignore[no-untyped-def]
    """Their derivatives."""
    u = 1.0 - t
    w[0] = -0.5 * u * u
    w[1] = (-12.0 * t + 9.0 * t * t) / 6.0
    w[2] = (12.0 * u - 9.0 * u * u) / 6.0
    w[3] = 0.5 * t * t


@njit(cache=True, error_model="numpy", inline="always")
def _box_of(x, y, z, origin, inverse, cells):  # type: ignore[no-untyped-def]
    """The first box that holds a point, or the last."""
    last = len(inverse) - 1
    for b in range(last):
        px = (x - origin[b, 0]) * inverse[b]
        py = (y - origin[b, 1]) * inverse[b]
        pz = (z - origin[b, 2]) * inverse[b]
        if 0.0 <= px <= cells[b, 0] and 0.0 <= py <= cells[b, 1] and 0.0 <= pz <= cells[b, 2]:
            return b
    return last


@njit(cache=True, error_model="numpy", inline="always")
def _split(p, n):  # type: ignore[no-untyped-def]
    """Cell and place in it of a place in 0 … n, of the nearest rim's for one outside; 0 where there is no cell."""
    p = min(max(p, 0.0), float(n))
    c = max(min(int(p), n - 1), 0)
    return c, p - c


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


@njit(cache=True, error_model="numpy", parallel=True, fastmath=_SUMS)
def spline_values(
    points: Floats, origin: Floats, inverse: Floats, cells: Indices, start: Indices, coefficients: Floats, out: Floats
) -> None:
    """Fill ``out`` (n, k) at (n, d) points.

    Parameters
    ----------
    points : (n, d) array
    origin, inverse, cells, start : (b, 3), (b,), (b, 3), (b,)
        Lower corner, 1 / spacing, cells and first coefficient of each box.
    coefficients : (c, k) array
    out : (n, k) array

    Notes
    -----
    Of three components in three dimensions the twelve numbers on a line of the stencil are summed at once, of two in
    two dimensions the eight; any other number of them one after the other.
    """
    (n, k), d = out.shape, points.shape[1]
    solid = k == 3 and cells[0, 2] > 0
    plane = k == 2 and cells[0, 2] == 0 and cells[0, 1] > 0
    numbers = coefficients.ravel()
    for block in prange((n + _BLOCK - 1) // _BLOCK):
        cell, w, total = np.empty(3, dtype=np.int64), np.empty((3, 4)), np.empty(k)
        for i in range(block * _BLOCK, min(n, (block + 1) * _BLOCK)):
            x, y, z = points[i, 0], points[i, 1] if d > 1 else 0.0, points[i, 2] if d > 2 else 0.0
            b = _box_of(x, y, z, origin, inverse, cells)
            cx, tx = _split((x - origin[b, 0]) * inverse[b], cells[b, 0])
            cy, ty = _split((y - origin[b, 1]) * inverse[b], cells[b, 1])
            cz, tz = _split((z - origin[b, 2]) * inverse[b], cells[b, 2])
            if solid:
                line = 3 * (cells[b, 2] + 3)
                first = 3 * (start[b] + cz) + (cx * (cells[b, 1] + 3) + cy) * line
                s = solid_sums(numbers, first, (cells[b, 1] + 3) * line, line, _four(tx), _four(ty))
                w0, w1, w2, w3 = _four(tz)
                out[i, 0] = w0 * s[0] + w1 * s[3] + w2 * s[6] + w3 * s[9]
                out[i, 1] = w0 * s[1] + w1 * s[4] + w2 * s[7] + w3 * s[10]
                out[i, 2] = w0 * s[2] + w1 * s[5] + w2 * s[8] + w3 * s[11]
            elif plane:
                line = 2 * (cells[b, 1] + 3)
                p = plane_sums(numbers, 2 * (start[b] + cy) + cx * line, line, _four(tx))
                w0, w1, w2, w3 = _four(ty)
                out[i, 0] = w0 * p[0] + w1 * p[2] + w2 * p[4] + w3 * p[6]
                out[i, 1] = w0 * p[1] + w1 * p[3] + w2 * p[5] + w3 * p[7]
            else:
                cell[0], cell[1], cell[2] = cx, cy, cz
                _value_weights(tx, w[0])
                _value_weights(ty, w[1])
                _value_weights(tz, w[2])
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
            x, y, z = points[i, 0], points[i, 1] if d > 1 else 0.0, points[i, 2] if d > 2 else 0.0
            b = _box_of(x, y, z, origin, inverse, cells)
            cell[0], t[0] = _split((x - origin[b, 0]) * inverse[b], cells[b, 0])
            cell[1], t[1] = _split((y - origin[b, 1]) * inverse[b], cells[b, 1])
            cell[2], t[2] = _split((z - origin[b, 2]) * inverse[b], cells[b, 2])
            for m in range(d):
                for axis in range(3):
                    if axis == m:
                        _slope_weights(t[axis], w[axis])
                    else:
                        _value_weights(t[axis], w[axis])
                _sum(cell, cells[b], start[b], w, coefficients, total)
                for c in range(k):
                    out[i, c, m] = total[c] * inverse[b]
