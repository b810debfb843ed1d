"""Factorized sparse approximate inverse: ``A⁻¹ ≈ Gᵀ G`` with G sparse and lower triangular in a coarse-to-fine order.

Row i of G solves the small dense system of point i and its nearest preceding points exactly (it minimises
``‖I − G L‖_F`` over the pattern, L the Cholesky factor). In a nested order the preceding points are near on every
scale, which makes the preconditioner work for radii of a few spacings and of the whole domain alike.

References
----------
L. Yu. Kolotilina, A. Yu. Yeremin, "Factorized sparse approximate inverse preconditionings I", SIAM J. Matrix Anal.
Appl. 14 (1993) 45–58. F. Schäfer, M. Katzfuss, H. Owhadi, "Sparse Cholesky factorization by Kullback–Leibler
minimization", SIAM J. Sci. Comput. 43 (2021) A2019–A2046: the coarse-to-fine order for kernel matrices.
"""

from typing import NamedTuple

import mesh_motion_kernels as kernels
import numpy as np
from scipy.sparse import csr_array

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.interpolation.factorizations.thinning import nearest_preceding, nested_levels
from mesh_motion_numerics.interpolation.kernels import Basis
from mesh_motion_numerics.interpolation.sparse_rows import SparseRows


class Iterated(NamedTuple):
    """The result of the iterations: solution and recurrences' residual (n, k), and the number of iterations."""

    solution: Floats
    residual: Floats
    iterations: int


class SparseInverse:
    """``z = Gᵀ G r`` for the points of one interpolation matrix.

    Parameters
    ----------
    points : (n, 3) array
    basis : Basis
        Positive definite.
    neighbours : int
        Preceding points per row. On the surfaces of a box and a wing (4 000 and 18 000 points, R = 2.5 … 0.05 of the
        domain) conjugate gradients need 160 … 30 iterations with 16, 47 … 13 with 32, 30 … 10 with 64, 25 … 9 with 96;
        the set-up grows from 0.1 to 1 s for 4 000 points.
    """

    def __init__(self, points: Floats, basis: Basis, support_radius: float, neighbours: int) -> None:
        order, near = nearest_preceding(points, nested_levels(points), neighbours)
        n = len(points)
        entries = np.empty((n, neighbours + 1))
        kernels.sparse_inverse_rows(
            basis.code, np.ascontiguousarray(points[order]), near, 1.0 / support_radius, entries
        )
        used = np.count_nonzero(near >= 0, axis=1)
        rows, places = np.nonzero(np.arange(neighbours + 1) <= used[:, None])
        source = used[rows] - 1 - places  # farthest first, as the kernel stored them
        ranks = np.where(source >= 0, near[rows, source], rows)
        short = rows.astype(np.int32), order[ranks].astype(np.int32)  # the product's index type
        factor = csr_array((entries[rows, places], short), shape=(n, n))
        self._factor, self._transposed = (
            SparseRows(each.indptr, each.indices, each.data) for each in (factor, factor.T.tocsr())
        )

    def __call__(self, residual: Floats) -> Floats:
        """(n, k) preconditioned residual."""
        return self._transposed.product(self._factor.product(residual))

    def conjugate_gradients(self, matrix: SparseRows, right: Floats, *, limit: float, most: int) -> Iterated:
        """Solve with the (n, n) matrix for right-hand sides (n, k), as :func:`.iterative.conjugate_gradients` does.

        Parameters
        ----------
        limit : float
            Largest magnitude of the remaining residual.
        most : int
            Largest number of iterations.
        """
        residual, solution = np.array(right, order="C"), np.empty(right.shape)
        matrices = *matrix, *self._factor, *self._transposed
        iterations: int = kernels.solve_sparse(*matrices, limit, most, residual, solution)
        return Iterated(solution, residual, iterations)
