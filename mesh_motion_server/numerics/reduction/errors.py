"""Errors at boundary nodes, compiled: their lengths, and one pass for a correction by a single basis function."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mesh_motion_server.numerics.kernel_functions import phi

__all__ = ["add_multiple", "lengths", "subtract_function"]

Floats = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def _lengths(vectors: Floats, out: Floats) -> None:
    for i in range(vectors.shape[0]):
        total = 0.0
        for c in range(vectors.shape[1]):
            total += vectors[i, c] * vectors[i, c]
        out[i] = math.sqrt(total)


def lengths(vectors: Floats) -> Floats:
    """(n,) Euclidean lengths of (n, k) vectors."""
    out = np.empty(len(vectors))
    _lengths(vectors, out)
    return out


@njit(cache=True, error_model="numpy")
def add_multiple(error: Floats, column: Floats, factor: Floats) -> None:
    """``error[i] += column[i] factor``, in place: (n, k), (n,), (k,)."""
    for i in range(error.shape[0]):
        for c in range(error.shape[1]):
            error[i, c] += column[i] * factor[c]


@njit(cache=True, error_model="numpy")
def subtract_function(
    code: int, points: Floats, node: int, inverse_radius: float, beta: Floats, error: Floats, size: Floats
) -> int:
    """Take β φ(|x − x_node|/R) off the errors; thesis (2.10) at the boundary.

    Parameters
    ----------
    points : (n, 3) array
    beta : (k,) array
    error : (n, k) array
        Changed in place.
    size : (n,) array
        Becomes the errors' lengths.

    Returns
    -------
    int
        The first node of the largest error.
    """
    x, y, z = points[node, 0], points[node, 1], points[node, 2]
    largest = 0
    for i in range(points.shape[0]):
        dx, dy, dz = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
        value = phi(code, math.sqrt(dx * dx + dy * dy + dz * dz) * inverse_radius)
        total = 0.0
        for c in range(error.shape[1]):
            error[i, c] -= value * beta[c]
            total += error[i, c] * error[i, c]
        size[i] = math.sqrt(total)
        if size[i] > size[largest]:
            largest = i
    return largest
