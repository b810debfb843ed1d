"""Weights of a selected set of nodes: at once, or as it grows one by one.

A node then costs two products of the set's size (thesis §2.2.3: N_c³).

With ``φ_cc = L Lᵀ`` the weights are ``γ = L⁻ᵀ y, y = L⁻¹ d``. A further node appends a row to L, a row w to
``W = L⁻¹``, and an entry to y: the scaled error of the earlier nodes at the new one. So ``γ = Σ_j w_j y_j`` only gains
a term, and no substitution is ever repeated.
"""

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.interpolation.factorizations.dense import LOST, PanelCholesky, singular
from mesh_motion_numerics.reduction.problem import ReductionProblem

_FIRST_CAPACITY = 64


class GrowingSet:
    """Selected nodes and their weights."""

    def __init__(self, problem: ReductionProblem) -> None:
        self._problem = problem
        self._selected = np.empty(problem.limit, dtype=np.int64)
        self._inverse = np.zeros((_FIRST_CAPACITY, _FIRST_CAPACITY))
        self._weights = np.zeros((_FIRST_CAPACITY, problem.displacement.shape[1]))
        self.count = 0

    @property
    def selected(self) -> Integers:
        """(count,) nodes in the order of selection."""
        return self._selected[: self.count]

    @property
    def weights(self) -> Floats:
        """(count, k) γ, which reproduce the displacement of the selected nodes."""
        return self._weights[: self.count]

    def errors(self, nodes: Integers) -> Floats:
        """(len(nodes), k) errors at the nodes, thesis (2.12)."""
        return self._problem.displacement[nodes] - self._problem.columns(self.selected, rows=nodes) @ self.weights

    def append(self, node: int) -> float:
        """Append a node; return the number of multiply-adds. Raises QualityRefused if its pivot is only rounding."""
        n = self.count
        self._reserve(n + 1)
        inverse = self._inverse[:n, :n]
        column = self._problem.columns(self.selected, rows=np.array([node]))[0]
        row = inverse @ column
        pivot = 1.0 - float(row @ row)
        if not pivot > LOST:  # relative to φ(0) = 1: the node is numerically equal to a selected one
            raise singular()
        left = self._problem.displacement[node] - column @ self.weights
        new = np.append(-(row @ inverse), 1.0) / np.sqrt(pivot)
        self._inverse[n, : n + 1] = new
        self._weights[: n + 1] += np.outer(new, left / np.sqrt(pivot))
        self._selected[n] = node
        self.count += 1
        return float(n) * n  # two products with a triangular matrix

    def _reserve(self, size: int) -> None:
        """Allocate memory for ``size`` nodes."""
        room = len(self._inverse)
        if size > room:
            self._inverse = np.pad(self._inverse, (0, room))
            self._weights = np.pad(self._weights, ((0, room), (0, 0)))


def full_weights(problem: ReductionProblem, selected: Integers) -> Floats:
    """(nc, k) weights that reproduce the displacement of the selected nodes, by a fresh factorization: thesis (2.4).

    Raises QualityRefused if the matrix is singular to working precision.
    """
    factor = PanelCholesky(
        len(selected), lambda first, last: problem.columns(selected[first:last], rows=selected[first:])
    )
    return factor.solve(problem.displacement[selected])


def full_operations(problem: ReductionProblem, count: int) -> float:
    """Multiply-adds of a solution: a Cholesky factor of order ``count``, two substitutions for k right-hand sides."""
    components = int(problem.displacement.shape[1])
    return float(count) ** 3 / 6.0 + components * float(count) ** 2
