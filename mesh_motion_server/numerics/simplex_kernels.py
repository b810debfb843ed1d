"""Size and skew of triangles and tetrahedra in one loop, without the sums over corners that other cells need.

The numbers are bitwise those of the general formulas of :mod:`~mesh_motion_server.numerics.corner_kernels`: a simplex
has one corner, and every operation is done in the same order. Most large meshes consist of tetrahedra, and what is
spared are the passes over the chunk in between.
"""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["cube_root", "tetra_all_above", "tetra_quality", "triangle_quality"]

# of a comparison of sixth powers whose terms are rounded some thirty times
_MARGIN = 1.0 + 1e-9
# products below may have lost digits
_TINY = 1e-280

_CUBE_ROOT_BITS = 0x2A9F7893782DA1CE  # makes bits(x)/3 a guess of the bits of ∛x, 4 % off at most


@njit(cache=True, error_model="numpy", inline="always")
def cube_root(x: float) -> float:
    """∛x for x > 0 to 2 ulp, in operations that vectorise (Halley's iteration triples the correct digits)."""
    bits = np.float64(x).view(np.int64)
    r: float = np.int64(np.float64(bits) * (1.0 / 3.0) + _CUBE_ROOT_BITS).view(np.float64)
    for _ in range(3):
        cube = r * r * r
        r = r * ((cube + 2.0 * x) / (2.0 * cube + x))
    return r


@njit(cache=True, error_model="numpy", inline="always")
def _finish(det, term, reference, s, size, skew, inverted):  # type: ignore[no-untyped-def]
    """From det A and f to size, skew and inverted of the cell s; NaN becomes -inf, the worst."""
    tau = det / reference
    ratio = abs(tau)
    ratio = min(ratio, 1.0 / ratio)
    valid = np.isfinite(det) and not np.isnan(term) and not np.isnan(tau)
    size[s] = (ratio if tau > 0.0 else -ratio) if valid else -np.inf
    skew[s] = 1.0 / term if valid else -np.inf
    inverted[s] = not det > 0.0 or not valid


@njit(cache=True, error_model="numpy", inline="always")
def _tetra_terms(a, s, ideal):  # type: ignore[no-untyped-def]
    """det A and q = tr(G λ) of the tetrahedron s of the buffer."""
    a00, a01, a02 = a[0, 0, s], a[0, 1, s], a[0, 2, s]
    a10, a11, a12 = a[1, 0, s], a[1, 1, s], a[1, 2, s]
    a20, a21, a22 = a[2, 0, s], a[2, 1, s], a[2, 2, s]
    det = a00 * (a11 * a22 - a21 * a12) + a10 * (a21 * a02 - a01 * a22) + a20 * (a01 * a12 - a11 * a02)
    l00 = a00 * a00 + a10 * a10 + a20 * a20
    l11 = a01 * a01 + a11 * a11 + a21 * a21
    l22 = a02 * a02 + a12 * a12 + a22 * a22
    l01 = a00 * a01 + a10 * a11 + a20 * a21
    l02 = a00 * a02 + a10 * a12 + a20 * a22
    l12 = a01 * a02 + a11 * a12 + a21 * a22
    q = ideal[0, 0] * l00 + ideal[1, 1] * l11 + ideal[2, 2] * l22
    q += 2.0 * (ideal[0, 1] * l01 + ideal[0, 2] * l02 + ideal[1, 2] * l12)
    return det, q


@njit(cache=True, error_model="numpy")
def tetra_quality(jacobians, first, count, ideal, reference, size, skew, inverted):  # type: ignore[no-untyped-def]
    """Of the tetrahedra in the buffer; ``ideal`` holds G, then det W in the last row."""
    a, ideal_det = jacobians[0], ideal[3, 0]
    for s in range(count):
        det, q = _tetra_terms(a, s, ideal)
        root = cube_root(abs(det) / ideal_det)
        term = q / (3.0 * root * root) if det != 0.0 else np.inf
        _finish(det, term, reference[first + s], s, size, skew, inverted)


@njit(cache=True, error_model="numpy", inline="always")
def _surely_above(det, q, reference, ideal_det, bound):  # type: ignore[no-untyped-def]
    """Whether the sixth power of a tetrahedron's size-skew is above the bound, for each of the ratios of its size."""
    own, told = det * det * det, reference * reference * reference
    t2 = det / ideal_det * (det / ideal_det)
    above, least = 729.0 * t2 * t2, bound * (q * q * q) * (q * q * q)
    grown, shrunk = above * told > least * own, above * own > least * told
    return grown & shrunk & (least * own > _TINY) & (least * told > _TINY)


@njit(cache=True, error_model="numpy")
def tetra_all_above(jacobians, first, count, ideal, reference, rest, limit):  # type: ignore[no-untyped-def]
    """Whether every tetrahedron in the buffer certainly has a size-skew above ``limit``; no roots, no divisions.

    With ``v = √size · skew`` and ``skew³ = 27 (det/det W)² / q³`` (2.14), ``v⁶ > limit⁶`` is two comparisons, one for
    each of the ratios whose smaller one is the size. A margin far above rounding keeps the answer true of the values as
    :func:`tetra_quality` computes them, from the same det and q; what leaves the range of numbers is never above. Where
    skews at ``rest`` are given, their relative size-skew: above the limit times that skew, and the size above limit².
    """
    a, ideal_det = jacobians[0], ideal[3, 0]
    bound = limit**6 * _MARGIN if limit > 0.0 else np.inf
    near = 0
    if rest.size == 0:
        for s in range(count):
            det, q = _tetra_terms(a, s, ideal)
            near += not _surely_above(det, q, reference[first + s], ideal_det, bound)
        return near == 0
    least = limit * limit * _MARGIN
    for s in range(count):
        det, q = _tetra_terms(a, s, ideal)
        told, squared = reference[first + s], rest[first + s] * rest[first + s]
        above = _surely_above(det, q, told, ideal_det, bound * squared * squared * squared)
        near += not (above & (det > least * told) & (told > least * det))
    return near == 0


@njit(cache=True, error_model="numpy")
def triangle_quality(jacobians, first, count, ideal, reference, size, skew, inverted):  # type: ignore[no-untyped-def]
    """Of the triangles in the buffer, as :func:`tetra_quality`."""
    a = jacobians[0]
    g00, g11, g01, factor = ideal[0, 0], ideal[1, 1], ideal[0, 1], 0.5 * ideal[2, 0]
    for s in range(count):
        a00, a01, a10, a11 = a[0, 0, s], a[0, 1, s], a[1, 0, s], a[1, 1, s]
        det = a00 * a11 - a01 * a10
        q = g00 * (a00 * a00 + a10 * a10) + g11 * (a01 * a01 + a11 * a11) + 2.0 * g01 * (a00 * a01 + a10 * a11)
        term = factor * q / abs(det) if det != 0.0 else np.inf
        _finish(det, term, reference[first + s], s, size, skew, inverted)
