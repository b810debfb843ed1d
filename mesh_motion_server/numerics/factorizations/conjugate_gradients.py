"""Preconditioned conjugate gradients for several right-hand sides that advance together.

The matrix is visited once an iteration for all of them; each has steps of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Iterated", "conjugate_gradients"]

Array = NDArray[np.float64]


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
    p, rz = z.copy(), np.sum(r * z, axis=0)
    for iteration in range(1, most + 1):
        ap = apply(p)
        alpha = _ratio(rz, np.sum(p * ap, axis=0))
        x += alpha * p
        r -= alpha * ap
        if done(r):
            return Iterated(x, r, iteration)
        z = precondition(r)
        rz, before = np.sum(r * z, axis=0), rz
        p = z + _ratio(rz, before) * p
    return Iterated(x, r, most)


def _ratio(a: Array, b: Array) -> Array:
    """``a / b`` by columns; 0 where a column is solved."""
    safe = np.where(b > 0.0, b, 1.0)
    return np.where(b > 0.0, a / safe, 0.0)
