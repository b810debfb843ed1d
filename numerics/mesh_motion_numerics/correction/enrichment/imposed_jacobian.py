"""Imposed gradients in two and three dimensions (thesis §5.1.2): the chapter 4 system with d × d Jacobians.

At every enrichment point a Jacobian J_S (5.5) is imposed on the displacement. With the boundary conditions this gives
one system for the weights γ and the coefficients α, β, … (5.4), (5.6), which are here the rows of C::

    [ φ_bb    H_bc  ] [ γ ]   [ d_b ]
    [ ∇φ_cb   ∇H_cc ] [ C ] = [ J_S ]

The existing factorization of the motion eliminates its first row: with the functions ψ of :mod:`.space` the
displacement is ``S + ψ C``, S the standard motion. ``∇ψ_cc C = J_S − ∇S_c`` remains, with K d unknowns for each
component, in any dimension d and for any solver.

The thesis does not say which Jacobian to impose in 2D: its parametric study (§5.1.2, Table 5.3) shows no pattern, and
it then uses "the predicted Jacobian values at the control point" (§5.1.3). :func:`imposed_jacobians` does the same: it
corrects the cell's own Jacobian by Algorithm 1 and imposes the result, at all worst-quality minima (4.11) at once,
and repeats this until the prediction reaches the threshold. One displacement cannot meet the conditions of neighbouring
points exactly, so the system is solved with a small penalty on the coefficients.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.correction.enrichment.eigen_correction import eigen_correction
from mesh_motion_numerics.correction.enrichment.functions import slope_at_point
from mesh_motion_numerics.correction.enrichment.placement import Placement, local_minima
from mesh_motion_numerics.correction.enrichment.space import EnrichmentSpace
from mesh_motion_numerics.correction.trial_nodes import TrialMesh
from mesh_motion_numerics.mesh.cells import CellTable

if TYPE_CHECKING:
    from mesh_motion_numerics.correction.correction_problem import CorrectionProblem

#: Penalty on the coefficients, relative to the slope of a function at its point. Values from 0.01 to 0.1 work about
#: equally well; without a penalty neighbouring points oppose each other until cells invert.
PENALTY = 0.05
#: Smallest distance between two points, as a share of R_l.
SPACING = 0.1


@dataclass(frozen=True, kw_only=True)
class ImposedSettings:
    """Choices of :func:`imposed_jacobians`."""

    enrichment_radius: float  # mesh length unit. R_l
    threshold: float = 0.2  # Stop when the predicted minimum reaches it
    max_points: int = 20
    max_rounds: int = 20  # Largest number of times that the Jacobians are imposed
    function: str = "H1"  # {"H1", "H2", "H3"}
    #: Displacement gradient J (d, d) of a cell → its change (d, d).
    correct_cell: Callable[[Floats], Floats] = eigen_correction


@dataclass(frozen=True, eq=False)
class ImposedJacobians:
    """The best round of :func:`imposed_jacobians`."""

    points: Floats  # (n, d), mesh length unit
    enrichment_points: Floats  # (K, d), mesh length unit
    minima: tuple[float, ...]  # Smallest quality after each round; the first is that of the standard motion


def impose(function_gradients: Floats, change: Floats, *, penalty: float = 0.0) -> Floats:
    """Coefficients C (s, d) for which ``∇ψ C`` is the change of the Jacobian at every point, thesis (5.6).

    Parameters
    ----------
    function_gradients : (K, s, d) array
        ``[c, m, j] = ∂ψ_m/∂x_j`` at point c.
    change : (K, d, d) array
        ``[c, i, j]``: J_S − ∇S at point c, ``∂S_i/∂x_j``; the thesis' J_S (5.5) is its transpose.
    penalty : float
        Weight of the coefficients relative to the conditions, which are then satisfied in the least-squares sense.
    """
    _, s, d = function_gradients.shape
    matrix = function_gradients.transpose(0, 2, 1).reshape(-1, s)
    right = change.transpose(0, 2, 1).reshape(-1, d)
    if penalty > 0.0:
        matrix = np.vstack([matrix, penalty * np.eye(s)])
        right = np.vstack([right, np.zeros((s, d))])
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0])


def cell_gradients(points: Floats, values: Floats, cells: CellTable, numbers: Integers) -> Floats:
    """(K, k, d) gradients of nodal values (n, k) in some cells (K,): exact for simplices, a fit for others."""
    out = np.empty((len(numbers), values.shape[1], points.shape[1]))
    for block, here, rows in cells.located(numbers):
        x, v = points[block.nodes[rows]], values[block.nodes[rows]]
        inverse = np.linalg.pinv(x - x.mean(axis=1, keepdims=True))
        out[here] = np.swapaxes(inverse @ (v - v.mean(axis=1, keepdims=True)), 1, 2)
    return out


@dataclass
class _Imposed:
    """The enrichment points so far, given by their cells (K,), with functions of unit slope at the points."""

    problem: CorrectionProblem
    settings: ImposedSettings
    numbers: Integers
    centres: Floats
    functions: Floats
    slopes: Floats

    @classmethod
    def nowhere(cls, problem: CorrectionProblem, settings: ImposedSettings) -> _Imposed:
        """Return an object without points: functions (n, 0), gradients (0, 0, d)."""
        n, d = problem.start.shape
        return cls(
            problem, settings, np.empty(0, dtype=np.int64), np.empty((0, d)), np.empty((n, 0)), np.empty((0, 0, d))
        )

    def add(self, minima: Integers) -> None:
        """Add the minima, worst first, that are not near the existing points."""
        p, settings = self.problem, self.settings
        first = len(self.numbers)
        for cell, centre in zip(minima.tolist(), p.cells.centres(p.start, minima), strict=True):
            nearest = np.linalg.norm(self.centres - centre, axis=1).min(initial=np.inf)
            if len(self.numbers) < settings.max_points and nearest > SPACING * settings.enrichment_radius:
                self.numbers = np.append(self.numbers, cell)
                self.centres = np.vstack([self.centres, centre])
        radii = np.full(len(self.numbers) - first, settings.enrichment_radius)
        placement = Placement(self.numbers[first:], self.centres[first:], radii)
        if len(radii):
            psi = EnrichmentSpace(placement, p.factorization, (settings.function,)).values(p.start)
            unit = slope_at_point(settings.function, settings.enrichment_radius)
            self.functions = np.hstack([self.functions, psi / unit])
            self.slopes = cell_gradients(p.start, self.functions, p.cells, self.numbers)

    def positions(self, points: Floats, quality: Floats) -> Floats:
        """Positions (n, d) with the corrected Jacobians imposed on the cells; good cells keep their Jacobians."""
        p, numbers = self.problem, self.numbers
        wanted = cell_gradients(p.start, points - p.start, p.cells, numbers)
        for row in np.flatnonzero(quality[numbers] < self.settings.threshold):
            wanted[row] += self.settings.correct_cell(wanted[row])
        standard = cell_gradients(p.start, p.standard - p.start, p.cells, numbers)
        moved = p.standard + self.functions @ impose(self.slopes, wanted - standard, penalty=PENALTY)
        moved[p.held] = p.standard[p.held]
        return np.asarray(moved)


def imposed_jacobians(problem: CorrectionProblem, mesh: TrialMesh, settings: ImposedSettings) -> ImposedJacobians:
    """Impose corrected Jacobians at the worst-quality minima until the prediction reaches the threshold.

    Parameters
    ----------
    mesh : TrialMesh
        Judges the quality.

    Notes
    -----
    "The Jacobian at a point" is computed from its cell's nodes. So for simplices it is imposed on the cell itself, not
    on the field at the cell's centre, which differs from it by O(h).
    """
    imposed, points = _Imposed.nowhere(problem, settings), problem.standard
    quality = mesh.quality(points)
    best, taken, minima = points, imposed.centres, [float(quality.min())]
    while minima[-1] < settings.threshold and len(minima) <= settings.max_rounds and np.isfinite(points).all():
        imposed.add(local_minima(problem.cells, quality, settings.threshold))
        if len(imposed.numbers) == 0:
            break
        points = imposed.positions(points, quality)
        quality = mesh.quality(points)
        if quality.min() > max(minima):
            best, taken = points, imposed.centres
        minima.append(float(quality.min()))
    return ImposedJacobians(best, taken, tuple(minima))
