"""Products of a sparse matrix with few columns at once, compiled: each row is one thread's sum, in stored order."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray
from scipy.sparse import csr_array

from mesh_motion_server.numerics.threads import threads_for
from mesh_motion_server.numerics.vector_lanes import LANES, row_sums

__all__ = ["in_lanes", "nbytes", "product"]

Floats = NDArray[np.float64]

_BLOCK = 128  # rows of one task


def in_lanes(vectors: Floats) -> Floats:
    """(n, k) vectors with columns of zeros added until their number is a multiple of four: the fastest to multiply."""
    missing = -vectors.shape[1] % LANES
    return np.ascontiguousarray(np.pad(vectors, ((0, 0), (0, missing))) if missing else vectors)


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
    groups = k // LANES if k % LANES == 0 else 0
    numbers = vectors.ravel()
    for block in prange((n + _BLOCK - 1) // _BLOCK):
        for i in range(block * _BLOCK, min(n, (block + 1) * _BLOCK)):
            first, last = np.int64(pointers[i]), np.int64(pointers[i + 1])
            for g in range(groups):
                s = row_sums(entries, columns, first, last, numbers, groups, g)
                m = LANES * g
                out[i, m], out[i, m + 1], out[i, m + 2], out[i, m + 3] = s
            if groups == 0:
                for m in range(k):
                    out[i, m] = 0.0
                for e in range(first, last):
                    for m in range(k):
                        out[i, m] += entries[e] * vectors[columns[e], m]
