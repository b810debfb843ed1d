"""The interpolation system of a positive definite basis, with or without a linear polynomial.

With a polynomial, thesis (2.4) is solved by its Schur complement: ``S = Pᵀ φ⁻¹ P``, ``S β = Pᵀ φ⁻¹ d``,
``γ = φ⁻¹ (d − P β)``, which works with every linear solver and keeps a sparse matrix sparse.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.blas import one_blas_thread
from mesh_motion_server.numerics.interpolation.factorizations import LinearSolver

__all__ = ["BorderedSystem"]

Array = NDArray[np.float64]


class BorderedSystem:
    """Weights and polynomial coefficients.

    Parameters
    ----------
    solver : LinearSolver
        Of φ.
    polynomial_matrix : (nc, d + 1) array or None
        P, of full rank.
    """

    def __init__(self, solver: LinearSolver, polynomial_matrix: Array | None) -> None:
        self._solver = solver
        self._p = polynomial_matrix
        if polynomial_matrix is not None:
            self._z = solver.solve(polynomial_matrix)
            with one_blas_thread():
                self._schur = polynomial_matrix.T @ self._z

    @property
    def name(self) -> str:
        """Name of the linear solver."""
        return self._solver.name

    @property
    def nbytes(self) -> int:
        """Memory it holds."""
        return self._solver.nbytes + (0 if self._p is None else 2 * self._p.nbytes)

    def solve(self, values: Array) -> tuple[Array, Array | None]:
        """(nc, k) weights and (d + 1, k) polynomial coefficients or None, of (nc, k) values."""
        if self._p is None:
            return self._solver.solve(values), None
        with one_blas_thread():
            beta: Array = np.linalg.solve(self._schur, self._z.T @ values).astype(np.float64)
            rest = values - self._p @ beta
        return self._solver.solve(rest), beta
