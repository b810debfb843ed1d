"""What the reductions share: the loop of the greedy ones, errors so far, counted cost, and whether to go on."""

from collections.abc import Callable

import mesh_motion_kernels as kernels
import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.reduction.problem import Iterate, Reduced, ReductionProblem

__all__ = ["Progress", "greedily", "lengths"]


def lengths(vectors: Floats) -> Floats:
    """(n,) Euclidean lengths of (n, k) vectors."""
    return np.asarray(kernels.lengths(np.ascontiguousarray(vectors)))


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


def greedily(
    problem: ReductionProblem,
    solve: Callable[[Integers], tuple[Floats, float]],
    choose: Callable[[Floats, int], Integers],
) -> Reduced:
    """Select nodes and interpolate from them until the tolerance is met.

    Parameters
    ----------
    solve : callable
        Selected nodes (nc,) → their weights (nc, k), and the multiply-adds for them.
    choose : callable
        Length (nb,) of the error at each node, −1 at selected ones, and how many nodes may be added → nodes to add.
    """
    progress = Progress(problem)
    selected = np.array([problem.start], dtype=np.int64)
    while True:
        weights, operations = solve(selected)
        level = problem.level(selected, weights)
        error = problem.displacement - problem.values(level)
        progress.count(solve=operations, error=float(problem.n_points) * len(selected))
        if progress.record(len(selected), error):
            return Reduced((level,), selected, error, tuple(progress.history))
        size = lengths(error)
        size[selected] = -1.0  # the error there is only rounding
        selected = np.append(selected, choose(size, problem.limit - len(selected)))
