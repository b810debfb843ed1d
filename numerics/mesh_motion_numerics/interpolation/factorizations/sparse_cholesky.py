"""The Cholesky factor of a sparse matrix of d × d blocks, whose order by nested dissection leaves little fill."""

from __future__ import annotations

from typing import NamedTuple

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats, Integers, Shorts

__all__ = ["Elimination", "SparseCholesky"]


class Elimination(NamedTuple):
    """The order (n,) in which rows are eliminated, and the pattern of L below its diagonal: column by column."""

    order: Shorts
    starts: Integers  # (n + 1,)
    rows: Shorts  # (e,)

    @classmethod
    def of(cls, starts: Integers, columns: NDArray[np.int32], places: Floats) -> Elimination:
        """Choose it for a symmetric pattern in compressed rows, for nodes at places (n, d)."""
        return cls(*kernels.elimination(starts, columns, np.ascontiguousarray(places)))


class SparseCholesky(NamedTuple):
    """``A = L Lᵀ``."""

    elimination: Elimination
    diagonal: Floats  # (n, d, d)
    below: Floats  # (e, d, d)

    @classmethod
    def build(
        cls, starts: Integers, columns: NDArray[np.int32], blocks: Floats, elimination: Elimination
    ) -> SparseCholesky | None:
        """Factorize the matrix with these blocks (b, d, d); None if it is not positive definite."""
        shape = blocks.shape[1:]
        diagonal, below = np.empty((len(starts) - 1, *shape)), np.empty((len(elimination.rows), *shape))
        definite = kernels.block_cholesky(starts, columns, blocks, *elimination, diagonal, below)
        return cls(elimination, diagonal, below) if definite else None

    @property
    def nbytes(self) -> int:
        """Bytes of the factor."""
        return sum(part.nbytes for part in (*self.elimination, self.diagonal, self.below))

    def solve(self, right: Floats) -> Floats:
        """Solve A x = right for x, both (n, d); with d = 1 for any number of columns."""
        found = np.empty(right.shape)
        kernels.block_cholesky_solve(*self.elimination, self.diagonal, self.below, np.ascontiguousarray(right), found)
        return found
