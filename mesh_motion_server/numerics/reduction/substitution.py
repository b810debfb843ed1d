"""Substitutions with a triangular matrix that grows a row at a time, compiled: no copy of the part in use."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mesh_motion_server.errors import NumericalError

__all__ = ["LOST", "back_substitute", "forward_substitute", "singular"]

Floats = NDArray[np.float64]

LOST = 64 * float(np.finfo(float).eps)
"""A pivot this small against φ(0) carries no correct digit."""


@njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract"})
def _dot(a: Floats, b: Floats) -> float:
    total = 0.0
    for j in range(a.size):
        total += a[j] * b[j]
    return total


@njit(cache=True, error_model="numpy")
def forward_substitute(lower: Floats, right: Floats) -> Floats:
    """x (n,) of ``L x = right`` (n,), L the leading block of ``lower``."""
    x = np.empty_like(right)
    for i in range(right.size):
        x[i] = (right[i] - _dot(lower[i, :i], x[:i])) / lower[i, i]
    return x


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def back_substitute(lower: Floats, right: Floats) -> Floats:
    """x (n, k) of ``Lᵀ x = right`` (n, k), L the leading block of ``lower``."""
    n, k = right.shape
    x = right.T.copy()
    for i in range(n - 1, -1, -1):
        for c in range(k):
            x[c, i] /= lower[i, i]
            for j in range(i):
                x[c, j] -= lower[i, j] * x[c, i]
    return x.T.copy()


def singular() -> NumericalError:
    """The error for a point that cannot be told from the selected ones: its pivot is lost in rounding."""
    return NumericalError(
        "the interpolation matrix of the selected control points is singular to working precision",
        code="FAILED_PRECONDITION",
        hint="take a larger reduction_tolerance, a smaller support radius or a less smooth basis",
    )
