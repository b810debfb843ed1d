"""Products of a sparse matrix with few columns at once, compiled: each row is one thread's sum, in stored order."""

from __future__ import annotations

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

__all__ = ["nbytes", "product"]

Floats = NDArray[np.float64]


def product(matrix: csr_array, vectors: Floats) -> Floats:
    """(m, k) product of an (m, n) matrix with (n, k) vectors; bitwise the same for any number of threads."""
    out = np.zeros((matrix.shape[0], vectors.shape[1]))
    kernels.add_product(
        np.arange(len(out)), matrix.indptr, matrix.indices, matrix.data, np.ascontiguousarray(vectors), out
    )
    return out


def nbytes(matrix: csr_array) -> int:
    """Memory of a matrix."""
    return int(matrix.data.nbytes + matrix.indices.nbytes + matrix.indptr.nbytes)
