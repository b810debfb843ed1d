"""Products of a sparse matrix with few columns at once, compiled: each row is one thread's sum, in stored order."""

import mesh_motion_kernels as kernels
import numpy as np
from scipy.sparse import csr_array

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.interpolation.assembly import SparseRows

__all__ = ["nbytes", "product"]


def product(matrix: csr_array, vectors: Floats) -> Floats:
    """(m, k) product of an (m, n) matrix with (n, k) vectors; bitwise the same for any number of threads."""
    out = np.zeros((matrix.shape[0], vectors.shape[1]))
    kernels.add_product(
        np.arange(len(out)), matrix.indptr, matrix.indices, matrix.data, np.ascontiguousarray(vectors), out
    )
    return out


def nbytes(matrix: csr_array | SparseRows) -> int:
    """Memory of a matrix."""
    return int(matrix.data.nbytes + matrix.indices.nbytes + matrix.indptr.nbytes)
