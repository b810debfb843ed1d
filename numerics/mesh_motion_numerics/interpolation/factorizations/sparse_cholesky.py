"""The Cholesky factor of a sparse matrix of points on surfaces, whose nested dissection has little fill."""

from __future__ import annotations

from dataclasses import dataclass

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.interpolation.assembly import SparseRows

__all__ = ["SparseCholesky"]


@dataclass(frozen=True, eq=False)
class SparseCholesky:
    """``A = L Lᵀ`` in an order of elimination."""

    #: order, starts, rows: (n,) int32, (n + 1,) int64, (e,) int32. The order, and the pattern of L below its diagonal
    #: by columns
    order: NDArray[np.int32]
    starts: Integers
    rows: NDArray[np.int32]
    #: diagonal, below: (n, 1, 1), (e, 1, 1). L
    diagonal: Floats
    below: Floats

    @classmethod
    def build(cls, matrix: SparseRows, points: Floats) -> SparseCholesky | None:
        """Factorize a symmetric matrix of points (n, d); None if it is not positive definite."""
        row_starts = matrix.indptr.astype(np.int64)
        order, starts, rows = kernels.elimination(row_starts, matrix.indices, np.ascontiguousarray(points))
        made = cls(order, starts, rows, np.empty((len(points), 1, 1)), np.empty((len(rows), 1, 1)))
        entries = matrix.data.reshape(-1, 1, 1)
        return made if kernels.block_cholesky(row_starts, matrix.indices, entries, *made._parts) else None

    @property
    def nbytes(self) -> int:
        """Bytes of the factor."""
        return sum(part.nbytes for part in self._parts)

    def solve(self, right: Floats) -> Floats:
        """(n, k) A⁻¹ times (n, k) right-hand sides."""
        found = np.empty(right.shape)
        kernels.block_cholesky_solve(*self._parts, np.ascontiguousarray(right), found)
        return found

    @property
    def _parts(self) -> tuple[NDArray[np.int32], Integers, NDArray[np.int32], Floats, Floats]:
        return self.order, self.starts, self.rows, self.diagonal, self.below
