"""Common data of the reductions: errors so far, counted cost, and whether to continue."""

import numpy as np

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.reduction.problem import Iterate, ReductionProblem

__all__ = ["Progress", "lengths"]


def lengths(vectors: Floats) -> Floats:
    """(n,) Euclidean lengths of (n, k) vectors."""
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))


class Progress:
    """Counts operations and records an :class:`Iterate` each time the errors are known."""

    def __init__(self, problem: ReductionProblem) -> None:
        self._problem = problem
        self._solve, self._error = 0.0, 0.0
        self.history: list[Iterate] = []

    def count(self, *, solve: float = 0.0, error: float = 0.0) -> None:
        """Add multiply-adds spent on weights, and φ evaluated or read for errors."""
        self._solve += solve
        self._error += error

    def record(self, points: int, error: Floats) -> bool:
        """Record the (n, k) remaining errors with this number of points; return whether to stop.

        The end is reached if the tolerance is met, or if no further point may be selected. A tolerance of 0 is met only
        by a zero error, so that rounding does not decide about the end.
        """
        size = lengths(error)
        largest = float(size.max())
        rms = float(np.sqrt(np.dot(size, size) / len(size)))
        self.history.append(Iterate(points, largest, rms, self._solve, self._error))
        return largest <= self._problem.allowed_error or points >= self._problem.limit
