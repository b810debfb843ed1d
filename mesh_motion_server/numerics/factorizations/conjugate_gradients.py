"""Preconditioned conjugate gradients for several right-hand sides that advance together.

The matrix is visited once an iteration for all of them; each has steps of its own. Sums over rows are formed in fixed
blocks: bitwise the same for any number of threads.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.numerics.threads import threads_for

__all__ = ["Iterated", "conjugate_gradients", "largest"]

Array = NDArray[np.float64]

_BLOCK = 512  # rows of one task


class Iterated(NamedTuple):
    """Where the iterations ended: solution and recurrences' residual (n, k), and how many were done."""

    solution: Array
    residual: Array
    iterations: int


def conjugate_gradients(
    right: Array,
    *,
    apply: Callable[[Array], Array],
    precondition: Callable[[Array], Array],
    done: Callable[[Array], bool],
    most: int,
) -> Iterated:
    """Solve for right-hand sides (n, k).

    Parameters
    ----------
    right : (n, k) array
    apply, precondition : callable
        Products (n, k) of the matrix and of its approximate inverse with (n, k) vectors.
    done : callable
        Whether to stop at a residual (n, k); asked after every iteration.
    most : int
        Iterations.
    """
    x, r = np.zeros_like(right), right.copy()
    z = precondition(r)
    p, rz = z.copy(), _column_products(r, z)
    for iteration in range(1, most + 1):
        ap = apply(p)
        with threads_for(float(right.size)):
            _advance(x, r, p, ap, _ratio(rz, _column_products(p, ap)))
        if done(r):
            return Iterated(x, r, iteration)
        z = precondition(r)
        rz, before = _column_products(r, z), rz
        with threads_for(float(right.size)):
            _redirect(p, z, _ratio(rz, before))
    return Iterated(x, r, most)


def largest(vectors: Array) -> float:
    """Largest magnitude in (n, k) vectors, 0 of none."""
    return max(float(vectors.max(initial=0.0)), -float(vectors.min(initial=0.0)))


def _ratio(a: Array, b: Array) -> Array:
    """``a / b`` by columns; 0 where a column is solved."""
    safe = np.where(b > 0.0, b, 1.0)
    return np.where(b > 0.0, a / safe, 0.0)


def _column_products(a: Array, b: Array) -> Array:
    """(k,) products of the columns of (n, k) vectors."""
    parts = np.empty(((len(a) + _BLOCK - 1) // _BLOCK, a.shape[1]))
    with threads_for(float(a.size)):
        _block_products(a, b, parts)
    return np.asarray(np.sum(parts, axis=0))


@njit(cache=True, error_model="numpy", parallel=True)
def _block_products(a: Array, b: Array, parts: Array) -> None:
    """Fill ``parts`` (blocks, k)."""
    n, k = a.shape
    for block in prange(parts.shape[0]):
        for c in range(k):
            parts[block, c] = 0.0
        for i in range(block * _BLOCK, min(n, (block + 1) * _BLOCK)):
            for c in range(k):
                parts[block, c] += a[i, c] * b[i, c]


@njit(cache=True, error_model="numpy", parallel=True)
def _advance(x: Array, r: Array, p: Array, ap: Array, alpha: Array) -> None:
    """``x += alpha p``, ``r −= alpha ap``, each column by its own alpha (k,)."""
    n, k = x.shape
    for block in prange((n + _BLOCK - 1) // _BLOCK):
        for i in range(block * _BLOCK, min(n, (block + 1) * _BLOCK)):
            for c in range(k):
                x[i, c] += alpha[c] * p[i, c]
                r[i, c] -= alpha[c] * ap[i, c]


@njit(cache=True, error_model="numpy", parallel=True)
def _redirect(p: Array, z: Array, beta: Array) -> None:
    """``p = z + beta p``."""
    n, k = p.shape
    for block in prange((n + _BLOCK - 1) // _BLOCK):
        for i in range(block * _BLOCK, min(n, (block + 1) * _BLOCK)):
            for c in range(k):
                p[i, c] = z[i, c] + beta[c] * p[i, c]
