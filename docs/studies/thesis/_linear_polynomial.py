"""The linear polynomial of (2.1) next to a basis that does not need it (Fig 2.2).

Thesis (2.4) is solved by its Schur complement: ``S = Pᵀ φ⁻¹ P``, ``S β = Pᵀ φ⁻¹ d``, ``γ = φ⁻¹ (d − P β)``, which works
with every linear solver and keeps a sparse matrix sparse. The server itself adds the polynomial only if a basis is not
definite without it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from mesh_motion_numerics.blas import one_blas_thread
from mesh_motion_numerics.interpolation.interpolant import AllCentreFactorization, Interpolant
from mesh_motion_numerics.interpolation.polynomial import LinearBasis, Polynomial
from numpy.typing import NDArray

__all__ = ["WithPolynomial"]

Floats = NDArray[np.float64]


class WithPolynomial:
    """A factorization of a positive definite basis, bordered by the linear polynomial."""

    def __init__(self, factorization: AllCentreFactorization) -> None:
        self.factorization = factorization
        self._linear = LinearBasis.around(factorization.control_points)
        self._p = self._linear.matrix(factorization.control_points)
        self._z = factorization.solve(self._p).weights
        with one_blas_thread():
            self._schur = self._p.T @ self._z

    def solve(self, values: Floats) -> Interpolant:
        """Interpolant of (nc, k) values at the control points."""
        with one_blas_thread():
            beta = np.linalg.solve(self._schur, self._z.T @ values).astype(np.float64)
            rest = values - self._p @ beta
        return replace(self.factorization.solve(rest), polynomial=Polynomial(self._linear, beta))
