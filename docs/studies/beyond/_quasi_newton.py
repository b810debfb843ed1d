"""L-BFGS on the coefficients of an enrichment space, for comparison with the package's Gauss–Newton iterations.

The objective is the package's: the p-mean of the distortion over all cells, through the same untangling and the same
continuation of p. Its gradient with respect to the coefficients is exact, ``dE/dC = ψᵀ dE/dy``. The smallest quality of
all cells stops it; the time to compute this quality is not counted.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from mesh_motion_numerics.correction.correction_problem import CorrectionProblem
from mesh_motion_numerics.correction.distortion import PNorm, determinants, distortion_gradient, mean_distortion
from mesh_motion_numerics.correction.enrichment.imposed_jacobian import cell_gradients
from mesh_motion_numerics.correction.enrichment.space import EnrichmentSpace
from mesh_motion_numerics.correction.free_region import gathered
from mesh_motion_numerics.correction.trial_nodes import LEVELS, TrialMesh
from numpy.typing import NDArray
from scipy.optimize import minimize

Floats = NDArray[np.float64]

VARIABLES = ("functions", "orthonormal")
"""Coefficients of the functions, each scaled by its gradient, or of the orthonormal basis that Gauss–Newton uses."""

_UNTANGLING, _STAGES = 80, 15  # iterations of one regularisation, and how many of those at most
_UNTANGLED = 1e-2
_JUDGE_EVERY = 5
_DEPENDENT = 3e-6
_OUTSIDE = 1e10  # what a line search gets for inverted cells


class QuasiNewton:
    """Result of one minimisation.

    Attributes
    ----------
    minimum : float
        Best quality of the worst cell so far.
    seconds : float
        CPU time, including the functions' values, without the quality.
    trace : list of (float, float)
        Seconds and best minimum at each evaluation of the quality.
    """

    def __init__(self, problem: CorrectionProblem, mesh: TrialMesh, space: EnrichmentSpace, variables: str) -> None:
        self._began = time.process_time()
        self._problem, self._mesh = problem, mesh
        self._region = mesh.free(~mesh.held)
        values = space.values(problem.start[self._region.free])
        self._psi = self._scaled(values) if variables == "functions" else _orthonormal(values)
        self._start = problem.standard[self._region.nodes]
        self._at = np.zeros(self._psi.shape[1] * problem.start.shape[1])
        self.minimum, self.evaluations = -math.inf, 0
        self.trace: list[tuple[float, float]] = []
        self.seconds = time.process_time() - self._began

    def _scaled(self, values: Floats) -> Floats:
        """The functions (f, s), each divided by the root mean square of its gradient in the cells."""
        everywhere = np.zeros((len(self._problem.start), values.shape[1]))
        everywhere[self._region.free] = values
        cells = self._problem.cells
        gradients = cell_gradients(self._problem.start, everywhere, cells, np.arange(len(cells)))
        return np.asarray(values / np.sqrt((gradients**2).sum(axis=2).mean(axis=0)))

    def run(self, iterations: int, goal: float) -> QuasiNewton:
        """Untangle, then minimise all p-means, each with a limited number of iterations, until the goal is reached."""
        for _ in range(_STAGES):
            least = float(determinants(self._points(self._at), self._region.simplices).min())
            if least > _UNTANGLED:
                break
            epsilon = max(1e-3, 0.5 * abs(least)) if least < 0.0 else 1e-2
            self._descend(PNorm(2, 1, epsilon), _UNTANGLING, goal)
        for norm in LEVELS:
            if self.minimum < goal:
                self._descend(norm, iterations, goal)
        return self

    def _points(self, coefficients: Floats) -> Floats:
        """(l, d) positions of the region's nodes."""
        points = self._start.copy()
        points[: self._region.n_free] += self._psi @ coefficients.reshape(self._psi.shape[1], -1)
        return points

    def _objective(self, coefficients: Floats, norm: PNorm) -> tuple[float, Floats]:
        """E and its gradient."""
        self.evaluations += 1
        points = self._points(coefficients)
        energy, weights = mean_distortion(points, self._region.simplices, norm)
        if not math.isfinite(energy):
            return _OUTSIDE, np.zeros_like(coefficients)
        shares = distortion_gradient(points, self._region.simplices, weights, norm)
        return energy, (self._psi.T @ gathered(self._region.adjacency, shares)).ravel()

    def _descend(self, norm: PNorm, iterations: int, goal: float) -> None:
        count = 0

        def after_each(coefficients: Floats) -> None:
            nonlocal count
            count += 1
            if count % _JUDGE_EVERY == 0:
                self._judge(coefficients)
                if self.minimum >= goal:
                    raise StopIteration

        self._began = time.process_time() - self.seconds
        options: dict[str, Any] = {"maxiter": iterations, "maxfun": 100 * iterations, "ftol": 1e-9}
        found = minimize(
            self._objective,
            self._at,
            (norm,),
            "L-BFGS-B",
            jac=True,
            callback=after_each,
            options=options,
        )
        self.seconds = time.process_time() - self._began
        self._at = found.x
        self._judge(self._at)

    def _judge(self, coefficients: Floats) -> None:
        """Record the minimum; the clock is stopped meanwhile."""
        paused = time.process_time()
        points = self._problem.standard.copy()
        points[self._region.free] = self._points(coefficients)[: self._region.n_free]
        self.minimum = max(self.minimum, float(self._mesh.quality(points).min()))
        self.trace.append((paused - self._began, self.minimum))
        self._began += time.process_time() - paused


def _orthonormal(values: Floats) -> Floats:
    """(f, r) orthonormal basis of the functions (f, s)."""
    left, singular, _ = np.linalg.svd(values / np.linalg.norm(values, axis=0), full_matrices=False)
    return np.ascontiguousarray(left[:, singular > _DEPENDENT * singular[0]])
