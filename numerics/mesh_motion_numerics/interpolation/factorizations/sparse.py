"""Sparse factorization of the interpolation matrix of a compact basis.

SuperLU in symmetric mode: minimum-degree ordering of the matrix's own graph, and pivots on the diagonal, which is
possible for a positive definite matrix.
"""

import numpy as np
from mesh_motion_protocol.errors import QualityRefused
from scipy.sparse import csr_array
from scipy.sparse.linalg import splu

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.blas import one_blas_thread

#: Bytes of a stored entry of the factors: a value and its row.
_BYTES_AN_ENTRY = 12


class SparseFactor:
    """Factors of a sparse symmetric positive definite matrix.

    Raises QualityRefused if a pivot vanishes.

    Parameters
    ----------
    matrix : (n, n) csr_array
        Rows and columns in the order ``order`` of the caller's points.
    order : (n,) int64 array
    """

    name = "sparse"

    def __init__(self, matrix: csr_array, order: Integers) -> None:
        self._order = order
        with one_blas_thread():
            try:
                self._factors = splu(
                    matrix.T.tocsc(copy=False),  # symmetric: the rows are the columns
                    permc_spec="MMD_AT_PLUS_A",
                    diag_pivot_thresh=0.0,
                    options={"SymmetricMode": True},
                )
            except RuntimeError as error:
                raise QualityRefused(
                    f"the sparse interpolation matrix cannot be factorized: {error}",
                    hint="take a smaller support radius, or separate control points that nearly coincide",
                ) from None

    @property
    def nbytes(self) -> int:
        """Memory of both factors."""
        return int(self._factors.nnz) * _BYTES_AN_ENTRY

    def solve(self, values: Floats) -> Floats:
        """(n, k) solution, rows in the caller's order."""
        out = np.empty(values.shape)
        with one_blas_thread():
            out[self._order] = self._factors.solve(np.ascontiguousarray(values[self._order]))
        return out
