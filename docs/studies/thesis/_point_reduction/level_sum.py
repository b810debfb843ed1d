"""A sum of interpolants, each of the error of the earlier ones; shared by the algorithms with levels."""

import numpy as np
from mesh_motion_numerics.arrays import Integers, bytes_of
from mesh_motion_numerics.interpolation.interpolant import AllCentreFactorization, factorize
from mesh_motion_numerics.reduction.growing_set import full_operations
from mesh_motion_numerics.reduction.problem import Level, Progress, Reduced, ReductionProblem
from mesh_motion_protocol.errors import InvalidInput

__all__ = ["LevelSum"]


class LevelSum:
    """The levels so far, and the remaining error.

    Attributes
    ----------
    error : (nb, k) array, mesh length unit
        Prescribed minus interpolated at all boundary nodes.
    centres : int
        Control points of all levels together, a measure of the cost of an evaluation.
    """

    def __init__(self, problem: ReductionProblem) -> None:
        self._problem = problem
        self._levels: list[Level] = []
        self._chosen: list[Integers] = []
        self.progress = Progress(problem)
        self.error = problem.displacement.copy()
        self.centres = 0

    def require_compact(self, name: str) -> None:
        """Raise InvalidInput if the basis has no compact support, so that the levels' radii have no meaning."""
        if not self._problem.row.compact:
            raise InvalidInput(
                f"reduction {name!r} needs a basis of compact support, not {self._problem.basis!r}",
                hint="take 'wendland-c2', or another reduction",
            )

    def add(self, selected: Integers, radius: float) -> bool:
        """Interpolate the error at the selected nodes; return True if the tolerance is met or all nodes are used."""
        factorization = factorize(self._problem.points[selected], basis=self._problem.basis, support_radius=radius)
        level = factorization.solve(self.error[selected])
        return self.append(level, selected, solve_operations=_operations(self._problem, factorization))

    def replace(self, selected: Integers) -> bool:
        """Remove the levels and interpolate the displacement itself at the selected nodes; returns as :meth:`add`."""
        self._levels, self._chosen, self.centres = [], [], 0
        self.error = self._problem.displacement.copy()
        return self.add(selected, self._problem.support_radius)

    def append(self, level: Level, selected: Integers, *, solve_operations: float) -> bool:
        """Append a level on the selected nodes, with its cost in multiply-adds; returns as :meth:`add`."""
        problem = self._problem
        self.error -= problem.values(level)
        self._levels.append(level)
        self._chosen.append(selected)
        self.centres += len(selected)
        visited = level.layout.fraction * len(selected) * problem.n_points
        self.progress.count(solve=solve_operations, error=visited)
        return self.progress.record(len(self.selected), self.error)

    @property
    def selected(self) -> Integers:
        """(nc,) nodes of all levels in the order of their selection, each once."""
        nodes, first = np.unique(np.concatenate(self._chosen), return_index=True)
        return nodes[np.argsort(first)]

    def reduced(self) -> Reduced:
        """The result."""
        return Reduced(tuple(self._levels), self.selected, self.error, tuple(self.progress.history))


def _operations(problem: ReductionProblem, factorization: AllCentreFactorization) -> float:
    """Multiply-adds of a factorization and its substitutions; estimated from its memory if it is not dense."""
    n = len(factorization.control_points)
    if factorization.solver == "dense":
        return full_operations(problem, n)
    entries = bytes_of(factorization) / 24  # of one triangle: a value and a row each, twice
    return float(entries * (entries / n + 2.0 * problem.displacement.shape[1]))
