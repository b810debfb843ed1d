"""The greedy algorithm with an LU factorization that grows with the points (Selim & Koomullil; thesis §2.2.3).

A new point borders the matrix with a column b, a row bᵀ and a diagonal entry c; the factors get borders too, so nothing
is factorized again::

    [A  b]   [L  0] [U  u]        L u = b,   lᵀ U = bᵀ,   υ = c − lᵀ u
    [bᵀ c] = [lᵀ 1] [0  υ]

The solution of L y = d grows by one row too; only the substitution U γ = y is repeated for each point. The cost falls
from the fourth to the third power of N_c; the errors are still computed from scratch.

References
----------
M. M. Selim, R. P. Koomullil, the thesis' [41]; described in thesis §2.2.3.
"""

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.interpolation.factorizations.dense import LOST, singular
from mesh_motion_numerics.reduction.problem import Reduced, ReductionProblem
from scipy.linalg import solve_triangular

from docs.studies.thesis._point_reduction.greedily import greedily

__all__ = ["GrowingLU", "reduce"]


_FIRST_SIZE = 64


def reduce(problem: ReductionProblem) -> Reduced:
    """Add the node of the largest error and extend the factors, until the tolerance is met."""
    factors = GrowingLU(problem.displacement.shape[1])

    def solve(selected: Integers) -> tuple[Floats, float]:
        node = selected[-1]
        factors.border(problem.columns(selected[-1:], rows=selected)[:, 0], problem.displacement[node])
        return factors.weights(), factors.operations()

    return greedily(problem, solve, lambda size, _: np.argmax(size, keepdims=True))


class GrowingLU:
    """Factors ``A = L U`` (L with a unit diagonal) of a symmetric matrix that grows by one row and column at a time.

    Parameters
    ----------
    columns : int
        k, right-hand sides.
    """

    def __init__(self, columns: int) -> None:
        self.order = 0
        self._lower = np.eye(_FIRST_SIZE)
        self._upper_transposed = np.zeros((_FIRST_SIZE, _FIRST_SIZE))
        self._forward = np.zeros((_FIRST_SIZE, columns))

    def border(self, column: Floats, values: Floats) -> None:
        """Add the (n + 1,) new column, its diagonal entry last, and the (k,) values of the new right-hand side row.

        Raises
        ------
        QualityRefused
            If the new pivot is only a rounding error.
        """
        n, column = self.order, np.ascontiguousarray(column)
        if n == len(self._forward):
            self._enlarge()
        u = _substituted(self._lower[:n, :n], column[:n])
        row = _substituted(self._upper_transposed[:n, :n], column[:n])
        pivot = column[n] - row @ u
        if not pivot > LOST * abs(column[n]):
            raise singular()
        self._lower[n, :n] = row
        self._upper_transposed[n, :n], self._upper_transposed[n, n] = u, pivot
        self._forward[n] = values - row @ self._forward[:n]
        self.order = n + 1

    def factors(self) -> tuple[Floats, Floats]:
        """(n, n) L and U."""
        n = self.order
        return self._lower[:n, :n], self._upper_transposed[:n, :n].T

    def weights(self) -> Floats:
        """(n, k) solution γ."""
        n = self.order
        return np.asarray(solve_triangular(self._upper_transposed[:n, :n], self._forward[:n], trans=1, lower=True))

    def operations(self) -> float:
        """Multiply-adds of the last border and its solution: three substitutions, one of them k times."""
        n = float(self.order)
        return n * n + self._forward.shape[1] * (n + 0.5 * n * n)

    def _enlarge(self) -> None:
        """Allocate memory for twice the order."""
        n = self.order
        lower, upper = np.eye(2 * n), np.zeros((2 * n, 2 * n))
        lower[:n, :n], upper[:n, :n] = self._lower, self._upper_transposed
        self._lower, self._upper_transposed = lower, upper
        self._forward = np.concatenate([self._forward, np.zeros_like(self._forward)])


def _substituted(lower: Floats, right: Floats) -> Floats:
    """(n,) x of a lower triangle (n, n): L x = right."""
    return np.asarray(solve_triangular(lower, right, lower=True)) if len(right) else right
