"""Products of a sparse matrix with few columns at once, compiled: each row is one thread's sum, in stored order."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray
from scipy.sparse import csr_array

from mesh_motion_server.numerics.threads import threads_for

__all__ = ["nbytes", "product"]

Floats = NDArray[np.float64]

_BLOCK = 128  # rows of one task


def product(matrix: csr_array, vectors: Floats) -> Floats:
    """(m, k) product of an (m, n) matrix with (n, k) contiguous vectors; bitwise the same for any number of threads."""
    out = np.empty((matrix.shape[0], vectors.shape[1]))
    with threads_for(2.0 * matrix.nnz):
        _multiply(matrix.indptr, matrix.indices, matrix.data, vectors, out)
    return out


def nbytes(matrix: csr_array) -> int:
    """Memory of a matrix."""
    return int(matrix.data.nbytes + matrix.indices.nbytes + matrix.indptr.nbytes)


@njit(cache=True, error_model="numpy", parallel=True)
def _multiply(
    pointers: NDArray[np.int32], columns: NDArray[np.int32], entries: Floats, vectors: Floats, out: Floats
) -> None:
    """Fill ``out`` (m, k)."""
    n, k = out.shape
    for block in prange((n + _BLOCK - 1) // _BLOCK):
        for i in range(block * _BLOCK, min(n, (block + 1) * _BLOCK)):
            if k == 3:  # three components in registers
                a, b, c = 0.0, 0.0, 0.0
                for e in range(pointers[i], pointers[i + 1]):
                    entry, j = entries[e], columns[e]
                    a += entry * vectors[j, 0]
                    b += entry * vectors[j, 1]
                    c += entry * vectors[j, 2]
                out[i, 0], out[i, 1], out[i, 2] = a, b, c
                continue
            for m in range(k):
                out[i, m] = 0.0
            for e in range(pointers[i], pointers[i + 1]):
                for m in range(k):
                    out[i, m] += entries[e] * vectors[columns[e], m]
