"""Compiled loops that do nothing but move numbers, or nothing but calculate: what the machine can do at most."""

from __future__ import annotations

from numba import njit, prange

__all__ = ["HORNER_FLOPS", "basis_sums", "horner", "read", "triad"]

#: Degree of the two polynomials of :func:`horner`.
_DEGREE = 32
#: Operations of one number in :func:`horner`.
HORNER_FLOPS = 4 * _DEGREE


@njit(parallel=True, fastmath=True)
def triad(a, b, c, blocks):  # type: ignore[no-untyped-def]
    """a = b + 3 c: two arrays are read, one is written."""
    size = (len(a) + blocks - 1) // blocks
    for block in prange(blocks):
        first, last = block * size, (block + 1) * size
        x, y, z = a[first:last], b[first:last], c[first:last]
        for i in range(len(x)):
            x[i] = y[i] + 3.0 * z[i]


@njit(parallel=True, fastmath=True)
def read(a, blocks, out):  # type: ignore[no-untyped-def]
    """Sums of the blocks of an array."""
    size = (len(a) + blocks - 1) // blocks
    for block in prange(blocks):
        total = 0.0
        part = a[block * size : (block + 1) * size]
        for i in range(len(part)):
            total += part[i]
        out[block] = total


@njit(parallel=True, fastmath=True)
def horner(values, turns, blocks, out):  # type: ignore[no-untyped-def]
    """Two polynomials of each of a few numbers, again and again: fused multiply-adds on registers."""
    for block in prange(blocks):
        total = 0.0
        for turn in range(turns):
            shift = 1e-9 * turn
            for i in range(len(values)):
                x = values[i] + shift
                first, second = x, x + 1.0
                for _ in range(_DEGREE):
                    first = first * x + 0.5
                    second = second * x + 0.25
                total += first + second
        out[block] = total


@njit(parallel=True, fastmath=True)
def basis_sums(points, centres, weights, out):  # type: ignore[no-untyped-def]
    """out (n, 3) = Σ φ(|x − c|) w of Wendland's C2 function over all centres (3, m) inside its support, not cut off."""
    for i in prange(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        a, b, c = 0.0, 0.0, 0.0
        for j in range(centres.shape[1]):
            dx, dy, dz = x - centres[0, j], y - centres[1, j], z - centres[2, j]
            xi = 0.4 * (dx * dx + dy * dy + dz * dz) ** 0.5
            rest = 1.0 - xi
            square = rest * rest
            value = square * square * (4.0 * xi + 1.0)
            a += value * weights[0, j]
            b += value * weights[1, j]
            c += value * weights[2, j]
        out[i, 0], out[i, 1], out[i, 2] = a, b, c
