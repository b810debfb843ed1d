"""A compact level at given places: the values there of all its functions, as a sparse matrix.

Few places are within reach of a level, and few centres of each. The matrix depends on centres and places only, so it is
made once for a state of the mesh and serves all displacements from there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray
from scipy.sparse import csr_array

from mesh_motion_server.numerics.assembly import sparse_rows
from mesh_motion_server.numerics.centres import padded
from mesh_motion_server.numerics.interpolant import Interpolant
from mesh_motion_server.numerics.sparse_products import in_lanes, nbytes
from mesh_motion_server.numerics.threads import threads_for
from mesh_motion_server.numerics.vector_lanes import LANES, row_sums

__all__ = ["NearOperator"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_BLOCK = 128  # rows of one task


@dataclass(frozen=True, eq=False)
class NearOperator:
    """A level's values at some places.

    Attributes
    ----------
    rows : (r,) int64 array
        Places that the level may reach, ascending; at all others it vanishes.
    matrix : (r, nc) csr_array
        Its functions there.
    """

    rows: Indices
    matrix: csr_array

    @classmethod
    def build(
        cls, level: Interpolant, points: Floats, *, unasked: Indices | None = None, threads: int | None = None
    ) -> NearOperator:
        """The operator of a compact level, whatever its weights, at points (n, d) but for the rows ``unasked`` (u,)."""
        rows = level.layout.within_reach(points, unasked=unasked, threads=threads)
        return cls(rows, sparse_rows(level.layout, level.basis, level.support_radius, padded(points[rows])))

    @property
    def nbytes(self) -> int:
        """Memory it holds."""
        return int(self.rows.nbytes) + nbytes(self.matrix)

    def add(self, weights: Floats, out: Floats, *, threads: int | None = None) -> None:
        """Add the level with weights (nc, k) to ``out`` (n, k)."""
        with threads_for(2.0 * self.matrix.nnz, threads):
            _add(self.rows, self.matrix.indptr, self.matrix.indices, self.matrix.data, in_lanes(weights), out)


@njit(cache=True, error_model="numpy", parallel=True)
def _add(
    rows: Indices,
    pointers: NDArray[np.int32],
    columns: NDArray[np.int32],
    entries: Floats,
    weights: Floats,
    out: Floats,
) -> None:
    """``out[rows] += matrix @ weights``; the weights' columns fill groups of lanes."""
    k, groups, numbers = out.shape[1], weights.shape[1] // LANES, weights.ravel()
    for block in prange((len(rows) + _BLOCK - 1) // _BLOCK):
        for i in range(block * _BLOCK, min(len(rows), (block + 1) * _BLOCK)):
            for g in range(groups):
                s = row_sums(entries, columns, np.int64(pointers[i]), np.int64(pointers[i + 1]), numbers, groups, g)
                for m in range(LANES * g, min(LANES * (g + 1), k)):
                    out[rows[i], m] += s[m - LANES * g]
