"""The multilevel subspace method (MLDR) with Wang's double-edged greedy choice of points (thesis §2.2.1, Table 2.3).

    level 1 interpolates the displacement on M nodes, level 2 the error of level 1 on M other nodes, and so on

Every level has its own small system, so that the work of choosing grows with the number of points times M, not with the
square of this number. A level's nodes are chosen greedily, two at a time from the same errors: the node
of the largest error, and the *other edge*, the node whose error is most opposed to it.

Levels share one support radius and are not orthogonal to each other: together they hold more control points than one
interpolant of the same error, and a node may be in several levels. If the levels need as many control points as there
are boundary nodes, a reduction saves nothing, and all nodes are interpolated at once.

References
----------
G. Wang, H. H. Mian, Z.-Y. Ye, J.-D. Lee, "Improved point selection method for hybrid-unstructured mesh deformation
using radial basis functions", AIAA J. 53 (2015) 1016–1025; thesis [45]. G. Wang, X. Chen, Z. Liu, "Mesh deformation on
3D complex configurations using multistep radial basis functions interpolation", Chin. J. Aeronaut. 31 (2018) 660–671;
thesis [44].
"""

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.interpolation.factorizations.dense import LOST, singular
from mesh_motion_numerics.reduction.problem import Reduced, ReductionProblem, lengths
from scipy.linalg import solve_triangular

from docs.studies.thesis._point_reduction.level_sum import LevelSum

__all__ = ["POINTS_PER_LEVEL", "reduce"]


POINTS_PER_LEVEL = 128
"""M."""


def reduce(problem: ReductionProblem, *, points_per_level: int = POINTS_PER_LEVEL) -> Reduced:
    """Add levels of a fixed number of points until the tolerance is met.

    ``max_points`` bounds the control points of all levels together.
    """
    field = LevelSum(problem)
    done = False
    while not done and field.centres < problem.limit:
        level = _GreedyLevel(problem, field.error, min(points_per_level, problem.limit - field.centres))
        done = field.append(
            problem.level(level.selected, level.weights()), level.selected, solve_operations=level.operations
        )
    if not done and problem.limit == problem.n_points:
        field.replace(np.arange(problem.n_points))
    return field.reduced()


class _GreedyLevel:
    """Nodes chosen by the double-edged greedy algorithm, up to ``size``, for the errors (nb, k) of earlier levels.

    The functions v_j are the Newton basis of the chosen nodes: v_j(x_i) = L_ij of φ_cc = L Lᵀ, and zero at the nodes
    before the j-th. So a further node costs one product at all boundary nodes and does not change earlier functions.
    """

    def __init__(self, problem: ReductionProblem, error: Floats, size: int) -> None:
        self._problem = problem
        self._error = error.copy()
        self._free = np.ones(len(error), dtype=bool)
        self._newton = np.empty((size, len(error)))
        self._coefficients = np.empty((size, error.shape[1]))
        self._chosen: list[int] = []
        self.operations = 0.0
        while not self._chosen or (len(self._chosen) < size and self._above()):
            for node in self._edges()[: size - len(self._chosen)]:
                self._append(node)

    @property
    def selected(self) -> Integers:
        """(n,) chosen nodes."""
        return np.array(self._chosen, dtype=np.int64)

    def weights(self) -> Floats:
        """(n, k) γ = L⁻ᵀ y."""
        n = len(self._chosen)
        triangle = self._newton[:n, self.selected].T
        return np.asarray(solve_triangular(triangle, self._coefficients[:n], lower=True, trans="T"))

    def _above(self) -> bool:
        """Return True if an error is above the tolerance."""
        return bool(lengths(self._error).max() > self._problem.allowed_error)

    def _edges(self) -> list[int]:
        """The free node of the largest error, and the node with the most opposed error, if any."""
        first = int(np.argmax(np.where(self._free, lengths(self._error), -1.0)))
        along = np.where(self._free, self._error @ self._error[first], 0.0)
        second = int(np.argmin(along))
        return [first, second] if along[second] < 0.0 else [first]

    def _append(self, node: int) -> None:
        """Add a node: compute its Newton function, and subtract its part from the errors."""
        n = len(self._chosen)
        earlier = self._newton[:n]
        function = self._problem.columns(np.array([node]))[:, 0] - earlier[:, node] @ earlier
        pivot = float(function[node])
        if not pivot > LOST:
            raise singular()
        function /= np.sqrt(pivot)
        self._newton[n] = function
        self._coefficients[n] = self._error[node] / function[node]
        self._error -= np.outer(function, self._coefficients[n])
        self._free[node] = False
        self._chosen.append(node)
        self.operations += float(n + 1 + self._error.shape[1]) * len(function)
