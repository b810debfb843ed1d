"""Conditionally definite bases: the saddle-point system of thesis (2.4) by its null space.

With the Householder factorization ``P = Q [R; 0]`` the side condition (2.3) says that Qᵀγ starts with d + 1 zeros, and
the rest solves ``(Q₂ᵀ φ Q₂) γ₂ = Q₂ᵀ d``, whose matrix is definite: it has a Cholesky factorization, as for any other
basis. Q is kept as ``I − V T Vᵀ``, so that the two-sided product is a correction of rank 2 (d + 1), panel by panel.

References
----------
G. H. Golub, C. F. Van Loan, *Matrix Computations*, 4th ed., §5.2.3 (block reflectors). M. D. Buhmann, *Radial Basis
Functions*, Cambridge 2003, ch. 5 (conditional definiteness).
"""

import numpy as np
from scipy.linalg import solve_triangular

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.blas import one_blas_thread
from mesh_motion_numerics.interpolation.assembly import dense_block
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.factorizations.dense import PanelCholesky
from mesh_motion_numerics.interpolation.factorizations.memory_bound import check_dense
from mesh_motion_numerics.interpolation.kernels import Basis
from mesh_motion_numerics.interpolation.polynomial import LinearBasis, Polynomial
from mesh_motion_numerics.mesh.points import padded


class NullSpaceCholesky:
    """Weights and polynomial coefficients of a basis that is definite only with a polynomial.

    Raises ResourceExhausted if the factor would take too much memory.
    """

    name = "dense"

    def __init__(self, control_points: Floats, basis: Basis, support_radius: float, linear: LinearBasis) -> None:
        check_dense(len(control_points))
        self._basis, self._radius, self.linear = basis, support_radius, linear
        self._layout = CentreLayout.build(control_points, basis, support_radius)
        self._points = padded(control_points)
        self._sign = -1.0 if basis.definiteness == "conditionally negative" else 1.0
        with one_blas_thread():
            self._reflectors, self._triangle, self._r = _householder(linear.matrix(control_points))
            self._correction = self._two_sided_correction()
        self._cholesky = PanelCholesky(len(control_points) - self._size, self._panel)

    @property
    def _size(self) -> int:
        """d + 1."""
        return int(self._r.shape[0])

    def _multiply(self, vectors: Floats) -> Floats:
        """(nc, k) product of the interpolation matrix."""
        # a basis without compact support: the layout has the order of the points
        return self._layout.product(self._basis, self._radius, self._points, vectors)

    def _two_sided_correction(self) -> Floats:
        """W with ``Qᵀ φ Q = φ − W Vᵀ − V Wᵀ``."""
        v = self._reflectors
        y = self._multiply(v @ self._triangle)
        return y - v @ (self._triangle.T @ (v.T @ y)) / 2.0

    def _panel(self, first: int, last: int) -> Floats:
        """Columns of ±Q₂ᵀ φ Q₂ from the diagonal down."""
        a, b = first + self._size, last + self._size
        v, w = self._reflectors, self._correction
        block = dense_block(self._basis, self._radius, self._points[a:], self._points[a:b])
        block -= w[a:] @ v[a:b].T + v[a:] @ w[a:b].T
        block *= self._sign
        return block

    def _rotate(self, vectors: Floats, triangle: Floats) -> Floats:
        """``vectors − V triangle Vᵀ vectors``."""
        v = self._reflectors
        return vectors - v @ (triangle @ (v.T @ vectors))

    def solve(self, values: Floats) -> tuple[Floats, Polynomial]:
        """(nc, k) weights and the polynomial of (nc, k) values."""
        q = self._size
        with one_blas_thread():
            rotated = self._rotate(values, self._triangle.T)
            rotated[:q] = 0.0
            rotated[q:] = self._sign * self._cholesky.solve(rotated[q:])
            weights = self._rotate(rotated, self._triangle)
            rest = self._rotate(values - self._multiply(weights), self._triangle.T)[:q]
            return weights, Polynomial(self.linear, solve_triangular(self._r, rest, lower=False, check_finite=False))

    def solve_bordered(self, values: Floats, moments: Floats) -> Floats:
        """The transpose: (nc, k) weights γ of (nc, k) values with ``Pᵀ γ`` = moments (d + 1, k) instead of zero."""
        p = self.linear.matrix(self._points[:, : self._size - 1])
        particular = p @ np.linalg.solve(p.T @ p, moments)
        return np.asarray(particular + self.solve(values - self._multiply(particular))[0])


def _householder(p: Floats) -> tuple[Floats, Floats, Floats]:
    """V (n, q), T (q, q) and R (q, q) of ``P = (I − V T Vᵀ) [R; 0]``, reflectors scaled so that ``|v|² = 2``."""
    r = np.array(p, dtype=np.float64)
    n, q = r.shape
    v = np.zeros((n, q))
    for j in range(q):
        u = r[j:, j].copy()
        u[0] += np.copysign(np.linalg.norm(u), u[0])
        v[j:, j] = u * (np.sqrt(2.0) / np.linalg.norm(u))
        r -= np.outer(v[:, j], v[:, j] @ r)
    # forward product of reflectors with τ = 1: T⁻¹ = I + the strict upper triangle of VᵀV
    triangle: Floats = np.linalg.inv(np.eye(q) + np.triu(v.T @ v, 1)).astype(np.float64)
    return v, triangle, np.triu(r[:q])
