"""Products of a sparse matrix with few columns at once, compiled: each row is one thread's sum, in stored order."""

from __future__ import annotations

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

__all__ = ["in_lanes", "nbytes", "product"]

Floats = NDArray[np.float64]

_LANES = 4


def in_lanes(vectors: Floats) -> Floats:
    """(n, k) vectors with columns of zeros added until their number is a multiple of four: the fastest to multiply."""
    missing = -vectors.shape[1] % _LANES
    return np.ascontiguousarray(np.pad(vectors, ((0, 0), (0, missing))) if missing else vectors)


def product(matrix: csr_array, vectors: Floats) -> Floats:
    """(m, k) product of an (m, n) matrix with (n, k) contiguous vectors; bitwise the same for any number of threads."""
    out = np.empty((matrix.shape[0], vectors.shape[1]))
    kernels.sparse_product(matrix.indptr, matrix.indices, matrix.data, vectors, out)
    return out


def nbytes(matrix: csr_array) -> int:
    """Memory of a matrix."""
    return int(matrix.data.nbytes + matrix.indices.nbytes + matrix.indptr.nbytes)
