"""The thesis' method of explicit iterations (§5.3): one enrichment point at a time, until the prediction is good.

Each iteration takes the worst predicted cell, computes by Algorithm 1 (:mod:`.eigen_correction`) the change dJ of the
displacement gradient that improves this cell, and adds an enrichment point at its centre with the coefficients
``relaxation × dJ / c`` (5.17; at its point ∇H is c times the identity, c = 1 for H1). By (5.15), (5.16) the boundary
condition still holds: the RBF weights compensate the enrichment at the boundary nodes (:mod:`.space`). Earlier points
are kept; the boundary's matrix is factorized once. The best predicted iterate is the result, because an improvement in
one place may worsen another.

The thesis predicts with the gradients at the cell centres. That prediction reaches a threshold before the mesh does
(rotation case of Table 5.6 after 15 iterations: predicted 0.28, actual 0.12), so here the prediction uses trial nodes.
It is exact, needs a few more iterations and reaches a better quality. A subclass of :class:`Trial` may predict in
another way, as the thesis' studies do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.correction.enrichment.eigen_correction import eigen_correction
from mesh_motion_numerics.correction.enrichment.functions import slope_at_point
from mesh_motion_numerics.correction.enrichment.placement import Placement
from mesh_motion_numerics.correction.enrichment.space import EnrichmentSpace
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import cell_quality

if TYPE_CHECKING:
    from mesh_motion_numerics.correction.correction_problem import CorrectionProblem


@dataclass(frozen=True, kw_only=True)
class ExplicitSettings:
    """Choices of the explicit iterations."""

    enrichment_radius: float  # R_l, mesh length unit
    threshold: float = 0.2  # Stop when the predicted minimum reaches it
    max_points: int = 20  # Largest number of iterations, each of which adds a point; the thesis uses 20
    #: Chooses the worst cell and is compared with the threshold; the thesis' 2D results are about ``size``.
    metric: str = "size-skew"
    relaxation: float = 2.0  # Over-relaxation of the coefficients; 1.3 to 2 work, the thesis does not give its value
    function: str = "H1"  # {"H1", "H2", "H3"}. Enrichment function
    #: Displacement gradient J (d, d) of a cell → its change dJ (d, d).
    correct_cell: Callable[[Floats], Floats] = eigen_correction


@dataclass(frozen=True)
class Iterate:
    """One iterate: the predicted minimum of the metric, the minimum of the displaced mesh, and the next worst cell."""

    predicted: float
    actual: float
    worst: int


@dataclass(frozen=True, eq=False)
class ExplicitResult:
    """The best predicted iterate."""

    points: Floats  # (n, d). Positions, mesh length unit; held nodes exactly in the positions of the standard motion
    enrichment_points: Floats  # (K, d), mesh length unit
    #: (K, d, d). ``[:, m, i]``: α, β of (5.15), the factor of H_m in component i of the displacement.
    coefficients: Floats
    best: int  # Number of this iterate; 0 is the standard motion
    reached: bool  # Whether its prediction is at or above the threshold
    history: tuple[Iterate, ...]  # All iterates, beginning with the standard motion


@dataclass(eq=False)
class Trial:
    """The motion with the points added so far (their centres and coefficients); no node of the mesh has moved yet."""

    problem: CorrectionProblem
    settings: ExplicitSettings
    positions: Floats
    terms: list[tuple[Floats, Floats]] = field(default_factory=list)

    def judged(self) -> Iterate:
        """The smallest predicted and actual quality, and the cell that is predicted worst."""
        quality = self.actual()
        worst = int(np.argmin(quality))  # of equal cells the first
        return Iterate(float(quality[worst]), float(quality[worst]), worst)

    def actual(self) -> Floats:
        """(m,) quality that the displaced mesh would have."""
        quality = cell_quality(self.positions, self.problem.cells, self.problem.reference_sizes)
        return quality.metric(self.settings.metric)

    def gradient(self, cell: int, centre: Floats) -> Floats:
        """(d, d) gradient of the displacement at a cell with this centre (d,)."""
        del centre
        return mean_gradient(self.problem.start, self.positions, self.problem.cells, cell)

    def add(self, centre: Floats, change: Floats) -> None:
        """Add an enrichment point that changes the gradient by (d, d) at its centre; held nodes do not move."""
        p, radius, function = self.problem, self.settings.enrichment_radius, self.settings.function
        placement = Placement(np.empty(0, dtype=np.int64), centre[None], np.array([radius]))
        coefficients = change.T / slope_at_point(function, radius)
        space = EnrichmentSpace(placement, p.factorization, (function,))
        moved = self.positions + space.displacement(p.start, coefficients)
        self.terms.append((centre, coefficients))
        self.positions = np.where(p.held[:, None], self.positions, moved)


def explicit_iterations(
    problem: CorrectionProblem, settings: ExplicitSettings, trial: Trial | None = None
) -> ExplicitResult:
    """Improve a motion with enrichment points until its prediction reaches the threshold.

    Parameters
    ----------
    trial : Trial, optional
        An object with another prediction; it has no points yet.
    """
    trial = trial or Trial(problem, settings, problem.standard)
    history, best, best_positions = [trial.judged()], 0, trial.positions
    while history[-1].predicted < settings.threshold and len(trial.terms) < settings.max_points:
        cell = history[-1].worst
        centre = problem.cells.centres(problem.start, np.array([cell]))[0]
        gradient = trial.gradient(cell, centre)
        if not np.isfinite(gradient).all():
            break  # the motion itself is not finite; no local change can repair it
        trial.add(centre, settings.relaxation * settings.correct_cell(gradient))
        history.append(trial.judged())
        if history[-1].predicted > history[best].predicted:
            best, best_positions = len(trial.terms), trial.positions
    d = problem.start.shape[1]
    return ExplicitResult(
        points=best_positions,
        enrichment_points=np.array([centre for centre, _ in trial.terms[:best]]).reshape(-1, d),
        coefficients=np.array([coefficients for _, coefficients in trial.terms[:best]]).reshape(-1, d, d),
        best=best,
        reached=history[best].predicted >= settings.threshold,
        history=tuple(history),
    )


def mean_gradient(before: Floats, after: Floats, cells: CellTable, cell: int) -> Floats:
    """(d, d) displacement gradient of a cell from its nodes: exact for simplices, the least-squares fit for others."""
    block, row = cells.locate(cell)
    nodes = block.nodes[row]
    x, y = before[nodes] - before[nodes].mean(axis=0), after[nodes] - after[nodes].mean(axis=0)
    return np.asarray(np.linalg.lstsq(x, y - x, rcond=None)[0].T)
