"""Sparse matrices in compressed rows, and Cholesky factors of symmetric ones of d × d blocks."""

from __future__ import annotations

from typing import NamedTuple

import mesh_motion_kernels as kernels
import numpy as np
from scipy.sparse import csr_array

from mesh_motion_numerics.arrays import Floats, Integers, Shorts


class SparseRows(NamedTuple):
    """A sparse matrix in compressed rows with SciPy's names but no checks, because every state of a mesh makes one."""

    indptr: Shorts  # (m + 1,)
    #: indices, data: (e,)
    indices: Shorts
    data: Floats

    def product(self, vectors: Floats) -> Floats:
        """(m, k) product with (n, k) vectors; each row is one thread's sum, in stored order."""
        out = np.zeros((len(self.indptr) - 1, vectors.shape[1]))
        kernels.add_product(np.arange(len(out)), *self, np.ascontiguousarray(vectors), out)
        return out

    def matrix(self, columns: int) -> csr_array:
        """Return the matrix (m, columns) for SciPy."""
        return csr_array((self.data, self.indices, self.indptr), shape=(len(self.indptr) - 1, columns))


class Elimination(NamedTuple):
    """The order (n,) in which rows are eliminated, by nested dissection, and the pattern of L below its diagonal."""

    order: Shorts
    starts: Integers  # (n + 1,)
    rows: Shorts  # (e,)

    @classmethod
    def of(cls, starts: Integers, columns: Shorts, places: Floats) -> Elimination:
        """Choose it for a symmetric pattern in compressed rows, for nodes at places (n, d)."""
        return cls(*kernels.elimination(starts, columns, np.ascontiguousarray(places)))


class SparseCholesky(NamedTuple):
    """``A = L Lᵀ``."""

    elimination: Elimination
    diagonal: Floats  # (n, d, d)
    below: Floats  # (e, d, d)

    @classmethod
    def build(
        cls, starts: Integers, columns: Shorts, blocks: Floats, elimination: Elimination
    ) -> SparseCholesky | None:
        """Factorize the matrix with these blocks (b, d, d); None if it is not positive definite."""
        shape = blocks.shape[1:]
        diagonal, below = np.empty((len(starts) - 1, *shape)), np.empty((len(elimination.rows), *shape))
        definite = kernels.block_cholesky(starts, columns, blocks, *elimination, diagonal, below)
        return cls(elimination, diagonal, below) if definite else None

    def solve(self, right: Floats) -> Floats:
        """Solve A x = right for x, both (n, d); with d = 1 for any number of columns."""
        found = np.empty(right.shape)
        kernels.block_cholesky_solve(*self.elimination, self.diagonal, self.below, np.ascontiguousarray(right), found)
        return found
