"""The greedy algorithm with a one-point correction instead of a solution (thesis §2.2.2, (2.8)–(2.10)).

    β = f_max / φ(0);  α_max ← α_max + β;  f(x) ← f(x) + β φ(|x − x_max|)

The correction removes the error at its node and ignores its effect on the others: cheap (N_b values of φ for each
point) and approximate. The largest error may return to a node that was corrected before; (2.9) then changes its
coefficient again, and no point is added.

With a wide support the approximate errors may never meet the tolerance, with any number of points. So a full
solution on the selected set decides: at the end, when the approximate errors meet the tolerance, and each time the
number of points has doubled. The corrections continue from its errors.

References
----------
T. C. S. Rendall, C. B. Allen, "Reduced surface point selection options for efficient mesh deformation using radial
basis functions", J. Comput. Phys. 229 (2010) 2810–2820.
"""

from collections.abc import Callable

import numpy as np
from mesh_motion_numerics.interpolation.kernels import values
from mesh_motion_numerics.reduction.growing_set import full_operations, full_weights
from mesh_motion_numerics.reduction.problem import Level, Progress, Reduced, ReductionProblem, lengths

__all__ = ["corrected_reduction", "reduce"]

#: Corrections of nodes that are selected already, between two new ones. 400 points on the tapered wing leave 0.0107,
#: 0.0085, 0.0054, 0.0050, 0.0049 of the displacement with at most 1, 3, 10, 30, 100 of them, for 1, 1.6, 2.8, 4.1, 4.9
#: times the values of φ; without a bound a tolerance near rounding would never be given up.
_REVISITS = 10
#: Points at the first full solution; a power of two.
_FIRST_CHECK = 16


def reduce(problem: ReductionProblem) -> Reduced:
    """One-point corrections, and a full solution each time the number of points has doubled."""
    return corrected_reduction(problem, lambda points: points >= _FIRST_CHECK and points & (points - 1) == 0)


def corrected_reduction(problem: ReductionProblem, full_due: Callable[[int], bool]) -> Reduced:
    """One-point corrections, and a full solution whenever ``full_due(points)`` and at the end."""
    corrections = _Corrections(problem)
    while True:
        done = corrections.add_point()
        if not done and not full_due(len(corrections.selected)):
            continue
        level, done = corrections.solve()
        if done:
            selected = np.array(corrections.selected)
            return Reduced((level,), selected, corrections.error, tuple(corrections.progress.history))


class _Corrections:
    """The selected nodes, and the (nb, k) error of the coefficients so far."""

    def __init__(self, problem: ReductionProblem) -> None:
        self.problem = problem
        self.progress = Progress(problem)
        self.selected: list[int] = []
        self.error = problem.displacement.copy()
        self._worst = problem.start
        self._size = lengths(self.error)
        self._chosen = np.zeros(problem.n_points, dtype=bool)
        self._at_zero = float(values(problem.row, np.zeros(1))[0])

    def add_point(self) -> bool:
        """Correct at the largest error until this selects a new node; return True if a full solution is due."""
        for _ in range(_REVISITS):
            if not self._chosen[self._worst]:
                break
            self._correct(self._worst)
        else:
            self._worst = int(np.argmax(np.where(self._chosen, -1.0, self._size)))
        self._chosen[self._worst] = True
        self.selected.append(self._worst)
        self._correct(self._worst)
        return self.progress.record(len(self.selected), self.error)

    def solve(self) -> tuple[Level, bool]:
        """The interpolant of the selected set, and True at the end."""
        selected = np.array(self.selected)
        level = self.problem.level(selected, full_weights(self.problem, selected))
        self.error = np.ascontiguousarray(self.problem.displacement - self.problem.values(level))
        self._size = lengths(self.error)
        self._worst = int(np.argmax(self._size))
        self.progress.count(
            solve=full_operations(self.problem, len(selected)), error=float(self.problem.n_points) * len(selected)
        )
        return level, self.progress.record(len(selected), self.error)

    def _correct(self, node: int) -> None:
        """Remove the error at a node, thesis (2.8)–(2.10)."""
        problem, beta = self.problem, self.error[node] / self._at_zero
        self.error -= np.outer(problem.columns(np.array([node]))[:, 0], beta)
        self._size = lengths(self.error)
        self._worst = int(np.argmax(self._size))
        self.progress.count(solve=float(len(beta)), error=float(problem.n_points))
