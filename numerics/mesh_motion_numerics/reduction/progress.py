"""What the reductions share: errors so far, counted cost, and whether to go on."""

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
        """Remember the (n, k) errors left with so many points; whether that is enough.

        Enough means: the tolerance is met, or no further point may be selected. A tolerance of 0 is met by a zero
        error only, so that rounding does not decide when it ends.
        """
        size = lengths(error)
        largest = float(size.max())
        rms = float(np.sqrt(np.dot(size, size) / len(size)))
        self.history.append(Iterate(points, largest, rms, self._solve, self._error))
        return largest <= self._problem.allowed_error or points >= self._problem.limit
