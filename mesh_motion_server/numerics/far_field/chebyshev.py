"""Polynomials in boxes by their values at Chebyshev points: from parent to child, to higher orders, and to the points.

A polynomial of p points an axis is exact for those of fewer, so nothing is lost on the way down the tree: the
polynomials of a box and of those above it end as one, which is evaluated at the points of a leaf.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.numerics.far_field.derivative_bounds import ORDERS

__all__ = ["box_points", "carry_down", "evaluate"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_LAST = ORDERS[-1]
# Sums may be contracted to fused operations; nothing is reassociated, so every machine adds in the same order.
_SUMS = {"contract"}


def _places() -> Floats:
    """(orders, points) Chebyshev points in [−1, 1]."""
    places = np.zeros((_LAST + 1, _LAST))
    for p in range(1, _LAST + 1):
        places[p, :p] = np.cos((2.0 * np.arange(p) + 1.0) * math.pi / (2.0 * p))
    return places


def _coefficients() -> Floats:
    """(orders, m, i): Lagrange function i of order p is ``Σ_m [p, m, i] T_m``, by discrete orthogonality."""
    coefficients = np.zeros((_LAST + 1, _LAST, _LAST))
    for p in range(1, _LAST + 1):
        angles = (2.0 * np.arange(p) + 1.0) * math.pi / (2.0 * p)
        coefficients[p, :p, :p] = 2.0 / p * np.cos(np.arange(p)[:, None] * angles)
        coefficients[p, 0, :p] = 1.0 / p
    return coefficients


def _higher() -> Floats:
    """(orders q, orders p, j, i): Lagrange function i of order p at point j of order q."""
    higher = np.zeros((_LAST + 1, _LAST + 1, _LAST, _LAST))
    for q in range(1, _LAST + 1):
        chebyshev = np.cos(np.arange(_LAST) * np.arccos(_PLACES[q, :q, None]))
        for p in range(1, q + 1):
            higher[q, p, :q, :p] = chebyshev[:, :p] @ _COEFFICIENTS[p, :p, :p]
    return higher


_PLACES, _COEFFICIENTS = _places(), _coefficients()
_HIGHER = _higher()


@njit(cache=True, error_model="numpy")
def _middle_and_half(low, high):  # type: ignore[no-untyped-def]
    """Middle and half of a side; half of a side without length is 1, so that its points are at 0."""
    half = 0.5 * (high - low)
    return 0.5 * (low + high), half if half > 0.0 else 1.0


@njit(cache=True, error_model="numpy", fastmath=_SUMS)
def _lagrange(u, order, out):  # type: ignore[no-untyped-def]
    """``out[:order]``: the Lagrange functions at u in [−1, 1]."""
    for i in range(order):
        out[i] = _COEFFICIENTS[order, 0, i]
    before, now = 1.0, u
    for m in range(1, order):
        for i in range(order):
            out[i] += _COEFFICIENTS[order, m, i] * now
        before, now = now, 2.0 * u * now - before


@njit(cache=True, error_model="numpy", parallel=True)
def box_points(box: Indices, order: Indices, starts: Indices, d: int, low: Floats, high: Floats, out: Floats) -> None:
    """The Chebyshev points of boxes ``box`` (g,), ``order^d`` each, into ``out[starts[g]:starts[g + 1]]`` (…, 3)."""
    for g in prange(box.size):
        b, p = box[g], order[g]
        py = p if d > 1 else 1
        pz = p if d > 2 else 1
        for i in range(p):
            for j in range(py):
                for k in range(pz):
                    row = starts[g] + (i * py + j) * pz + k
                    index = (i, j, k)
                    for m in range(3):
                        middle, half = _middle_and_half(low[b, m], high[b, m])
                        place = _PLACES[p, index[m]] if m < d and high[b, m] > low[b, m] else 0.0
                        out[row, m] = middle + half * place


@njit(cache=True, error_model="numpy", fastmath=_SUMS)
def _add_multiple(factor, values, out):  # type: ignore[no-untyped-def]
    """``out += factor values``."""
    for i in range(out.size):
        out[i] += factor * values[i]


@njit(cache=True, error_model="numpy", fastmath=_SUMS)
def _add_resampled(values, p, matrices, q, d, k, out):  # type: ignore[no-untyped-def]
    """Add the polynomial with flat ``values`` (p^d k,) to ``out`` (q^d k,), through matrices (3, q, p) of each axis."""
    py, qy = (p, q) if d > 1 else (1, 1)
    pz, qz = (p, q) if d > 2 else (1, 1)
    plane, line = np.empty(py * pz * k), np.empty(pz * k)
    for x in range(q):
        plane[:] = 0.0
        for i in range(p):
            _add_multiple(matrices[0, x, i], values[i * plane.size : (i + 1) * plane.size], plane)
        for y in range(qy):
            line[:] = 0.0
            for j in range(py):
                weight = matrices[1, y, j] if d > 1 else 1.0
                _add_multiple(weight, plane[j * line.size : (j + 1) * line.size], line)
            for z in range(qz):
                at = ((x * qy + y) * qz + z) * k
                for m in range(pz):
                    weight = matrices[2, z, m] if d > 2 else 1.0
                    for c in range(k):
                        out[at + c] += weight * line[m * k + c]


@njit(cache=True, error_model="numpy", parallel=True)
def carry_down(
    levels: Indices,
    parent: Indices,
    low: Floats,
    high: Floats,
    order: Indices,
    starts: Indices,
    groups: tuple[Indices, Indices, Indices, Floats],
    d: int,
    k: int,
    values: Floats,
) -> None:
    """The polynomial of every box: those of its groups and its parent's.

    Parameters
    ----------
    levels : (l + 1,) int64 array
    parent, low, high : (b,), (b, 3), (b, 3) arrays
    order : (b,) int64 array
        At least the parent's and those of the box's groups; 0 where there is no polynomial.
    starts : (b + 1,) int64 array
        First entry of each box in ``values``.
    groups : tuple
        (b + 1,) first group of each box, (g,) order, (g + 1,) first row of values, and (r, k) values at the points of
        :func:`box_points`.
    d, k : int
    values : (v,) array
        To be filled: of each box (order^d, k), flat.
    """
    first_group, group_order, group_start, group_values = groups
    for level in range(levels.size - 1):
        for box in prange(levels[level], levels[level + 1]):
            q = order[box]
            if q == 0:
                continue
            own = values[starts[box] : starts[box + 1]]
            own[:] = 0.0
            matrices = np.empty((3, q, _LAST))
            for g in range(first_group[box], first_group[box + 1]):
                p = group_order[g]
                for m in range(d):
                    matrices[m] = _HIGHER[q, p, :q]
                told = group_values[group_start[g] : group_start[g + 1]].reshape(-1)
                _add_resampled(told, p, matrices, q, d, k, own)
            above = parent[box]
            if above >= 0 and order[above] > 0:
                p = order[above]
                for m in range(d):
                    middle, half = _middle_and_half(low[above, m], high[above, m])
                    own_middle, own_half = _middle_and_half(low[box, m], high[box, m])
                    if high[box, m] <= low[box, m]:
                        own_half = 0.0
                    for i in range(q):
                        _lagrange((own_middle + own_half * _PLACES[q, i] - middle) / half, p, matrices[m, i])
                _add_resampled(values[starts[above] : starts[above + 1]], p, matrices, q, d, k, own)


@njit(cache=True, error_model="numpy", fastmath=_SUMS, parallel=True)
def evaluate(
    leaves: Indices,
    points_of: Indices,
    points: Floats,
    low: Floats,
    high: Floats,
    order: Indices,
    starts: Indices,
    values: Floats,
    d: int,
    out: Floats,
) -> None:
    """Add the polynomials of the leaves to ``out`` (n, k) at their sorted points (n, 3); the rest as above."""
    k = out.shape[1]
    for number in prange(leaves.size):
        box = leaves[number]
        p = order[box]
        if p == 0:
            continue
        py = p if d > 1 else 1
        pz = p if d > 2 else 1
        own = values[starts[box] : starts[box + 1]]
        weights, plane, line = np.ones((3, _LAST)), np.empty(py * pz * k), np.empty(pz * k)
        for i in range(points_of[box, 0], points_of[box, 1]):
            for m in range(d):
                middle, half = _middle_and_half(low[box, m], high[box, m])
                _lagrange((points[i, m] - middle) / half, p, weights[m])
            plane[:] = 0.0
            for x in range(p):
                _add_multiple(weights[0, x], own[x * plane.size : (x + 1) * plane.size], plane)
            line[:] = 0.0
            for y in range(py):
                _add_multiple(weights[1, y], plane[y * line.size : (y + 1) * line.size], line)
            for z in range(pz):
                for c in range(k):
                    out[i, c] += weights[2, z] * line[z * k + c]
