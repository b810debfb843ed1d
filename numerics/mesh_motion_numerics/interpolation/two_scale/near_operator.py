"""A compact level at given places: the values of all its functions there, as a sparse matrix.

Few places are within reach of a level, and each of them is near few centres. The matrix depends only on centres and
places, so it is made once for a state of the mesh and used for all displacements from this state.
"""

from __future__ import annotations

from dataclasses import dataclass

import mesh_motion_kernels as kernels
import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.interpolation.assembly import SparseRows, rows_near, sparse_rows
from mesh_motion_numerics.interpolation.interpolant import Interpolant
from mesh_motion_numerics.interpolation.sparse_products import nbytes

__all__ = ["NearOperator"]


@dataclass(frozen=True, eq=False)
class NearOperator:
    """A level's values at some places.

    Attributes
    ----------
    rows : (r,) int64 array
        Places that the level may reach, with neighbours next to each other; at all other places the level is 0.
    matrix : SparseRows
        Values of the level's functions there.
    """

    rows: Integers
    matrix: SparseRows

    @classmethod
    def build(cls, level: Interpolant, points: Floats, *, skipped: Integers | None = None) -> NearOperator:
        """The operator of a compact level, whatever its weights, at points (n, d) but for the rows ``skipped`` (u,)."""
        rows, near = rows_near(level.layout, level.support_radius, points, skipped=skipped)
        return cls(rows, sparse_rows(level.layout, level.basis, level.support_radius, near))

    @property
    def nbytes(self) -> int:
        """Bytes of the operator."""
        return int(self.rows.nbytes) + nbytes(self.matrix)

    def add(self, weights: Floats, out: Floats) -> None:
        """Add the level with weights (nc, k) to ``out`` (n, k)."""
        matrix = self.matrix
        kernels.add_product(self.rows, matrix.indptr, matrix.indices, matrix.data, np.ascontiguousarray(weights), out)

    def transpose(self, weights: Floats, centres: int) -> Floats:
        """The transpose: (nc, k) derivatives by the weights of the ``centres``, for (n, k) weights of the values."""
        out, matrix = np.empty((centres, weights.shape[1])), self.matrix
        kernels.transposed_product(
            self.rows, matrix.indptr, matrix.indices, matrix.data, np.ascontiguousarray(weights), out
        )
        return out
