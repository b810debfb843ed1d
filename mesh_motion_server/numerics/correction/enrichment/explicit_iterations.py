"""The thesis' method of explicit iterations (§5.3): one enrichment point at a time, until the prediction is good.

Each iteration takes the worst predicted cell, computes by a decomposition (Algorithm 1 by default, see
:data:`~.stretch_correction.CELL_CORRECTIONS`) the change dJ of the displacement gradient that improves this cell, and
adds an enrichment point at its centre with the coefficients ``relaxation × dJ / c`` (5.17; at its point ∇H is c times
the identity, c = 1 for H1). By (5.16) the boundary condition still holds: the RBF weights compensate the enrichment at
the boundary nodes. Earlier points stay; the boundary's matrix is factorized once. The best predicted iterate is the
result, since improving one place may worsen another.

The thesis predicts with the gradients at the cell centres. That prediction reaches a threshold before the mesh does
(rotation case of Table 5.6 after 15 iterations: predicted 0.28, actual 0.12), so the default here predicts with trial
nodes, which is exact, needs a few more iterations and reaches a better quality. Both values are reported for every
iterate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.correction.enrichment import functions
from mesh_motion_server.numerics.correction.enrichment.placement import worst_cell
from mesh_motion_server.numerics.correction.enrichment.stretch_correction import CELL_CORRECTIONS
from mesh_motion_server.numerics.interpolation.evaluation import Evaluator
from mesh_motion_server.numerics.interpolation.interpolant import Factorization
from mesh_motion_server.numerics.interpolation.two_scale.interpolant import AnyInterpolant
from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.numerics.quality.metrics import CellQuality, cell_quality
from mesh_motion_server.numerics.quality.prediction import PREDICTORS, DisplacementField, predict

if TYPE_CHECKING:
    from mesh_motion_server.numerics.correction.correction_problem import CorrectionProblem

__all__ = ["ExplicitResult", "ExplicitSettings", "Iterate", "explicit_iterations"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ExplicitSettings:
    """Choices of the explicit iterations.

    Attributes
    ----------
    enrichment_radius : float
        R_l, mesh length unit.
    threshold : float
        Stop when the predicted minimum reaches it.
    max_points : int
        Largest number of iterations, each of which adds a point; the thesis uses 20.
    metric : str
        Chooses the worst cell and is compared with the threshold; the thesis' 2D results are about ``size``.
    relaxation : float
        Over-relaxation of the coefficients; 1.3 to 2 work, the thesis does not give its value.
    predictor : str
        One of :data:`~mesh_motion_server.numerics.quality.prediction.PREDICTORS`; the thesis uses ``centre-gradient``.
    function : {"H1", "H2", "H3"}
        Enrichment function.
    decomposition : {"eigen", "polar", "svd", "qr"}
        How a cell is corrected.
    """

    enrichment_radius: float
    threshold: float = 0.2
    max_points: int = 20
    metric: str = "size-skew"
    relaxation: float = 2.0
    predictor: str = "trial-nodes"
    function: str = "H1"
    decomposition: str = "eigen"

    def __post_init__(self) -> None:
        for name in ("enrichment_radius", "relaxation"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise InvalidInput(f"{name}: expected a positive number, got {getattr(self, name)!r}")
        if self.predictor not in PREDICTORS:
            raise InvalidInput(f"unknown predictor {self.predictor!r}; known are {', '.join(PREDICTORS)}")
        if self.decomposition not in CELL_CORRECTIONS:
            raise InvalidInput(f"unknown decomposition {self.decomposition!r}; known are {', '.join(CELL_CORRECTIONS)}")
        functions.slope_at_point(self.function, self.enrichment_radius)  # refuses unknown functions


@dataclass(frozen=True)
class Iterate:
    """One iterate: predicted minimum of the metric, that of the displaced mesh, and the next worst cell."""

    predicted: float
    actual: float
    worst: int


@dataclass(frozen=True, eq=False)
class ExplicitResult:
    """The best predicted iterate.

    Attributes
    ----------
    points : (n, d) array
        Positions, mesh length unit; held nodes exactly where the standard motion put them.
    enrichment_points : (K, d) array, mesh length unit
    coefficients : (K, d, d) array
        ``[:, m, i]``: α, β of (5.15), the factor of H_m in component i of the displacement.
    best : int
        Number of this iterate; 0 is the standard motion.
    reached : bool
        Whether its prediction is at or above the threshold.
    history : tuple of Iterate
        From the standard motion on.
    """

    points: Floats
    enrichment_points: Floats
    coefficients: Floats
    best: int
    reached: bool
    history: tuple[Iterate, ...]


@dataclass(frozen=True, eq=False)
class EnrichmentTerm:
    """``H(x) C − Σ_b γ_b φ``: an enrichment point's displacement, zero at the control points; thesis (5.15), (5.16)."""

    centre: Floats
    radius: float
    coefficients: Floats
    compensation: AnyInterpolant
    evaluator: Evaluator
    function: str = "H1"

    @classmethod
    def build(
        cls,
        centre: Floats,
        radius: float,
        coefficients: Floats,
        factorization: Factorization,
        evaluator: Evaluator,
        *,
        function: str = "H1",
    ) -> EnrichmentTerm:
        """The term with coefficients (d, d) at a centre (d,)."""
        at_boundary = functions.values(function, factorization.control_points, centre, radius) @ coefficients
        return cls(centre, radius, coefficients, factorization.solve(-at_boundary), evaluator, function)

    def displacement(self, points: Floats) -> Floats:
        """(n, d) displacement of points (n, d)."""
        own = functions.values(self.function, points, self.centre, self.radius) @ self.coefficients
        return np.asarray(own + self.evaluator.displacement(self.compensation, points))

    def gradient(self, points: Floats) -> Floats:
        """(n, d, d) gradient, ``[:, i, j] = ∂S_i/∂x_j``."""
        own = functions.gradients(self.function, points, self.centre, self.radius)
        return np.asarray(
            np.einsum("nmj,mi->nij", own, self.coefficients) + self.evaluator.gradient(self.compensation, points)
        )


@dataclass(frozen=True)
class SumField:
    """A displacement field that is the sum of others."""

    fields: tuple[DisplacementField, ...]

    def displacement(self, points: Floats) -> Floats:
        """(n, d) displacement of points (n, d)."""
        return np.asarray(np.sum([f.displacement(points) for f in self.fields], axis=0))

    def gradient(self, points: Floats) -> Floats:
        """(n, d, d) gradient."""
        return np.asarray(np.sum([f.gradient(points) for f in self.fields], axis=0))


@dataclass
class _Trial:
    """The motion with the points added so far; no node of the mesh has moved yet."""

    problem: CorrectionProblem
    settings: ExplicitSettings
    standard: DisplacementField | None
    positions: Floats
    terms: list[EnrichmentTerm] = field(default_factory=list)

    def prediction(self) -> CellQuality:
        """Predicted quality of all cells."""
        if self.standard is None:
            return self.actual()
        total = SumField((self.standard, *self.terms))
        p = self.problem
        return predict(self.settings.predictor, p.start, p.cells, p.reference_sizes, total)

    def actual(self) -> CellQuality:
        """Quality that the displaced mesh would have."""
        return cell_quality(self.positions, self.problem.cells, self.problem.reference_sizes)

    def gradient(self, cell: int, centre: Floats) -> Floats:
        """(d, d) gradient of the displacement at a cell."""
        if self.standard is not None:
            return np.asarray(SumField((self.standard, *self.terms)).gradient(centre[None])[0])
        return mean_gradient(self.problem.start, self.positions, self.problem.cells, cell)

    def add(self, centre: Floats, change: Floats) -> None:
        """Add an enrichment point that changes the gradient by (d, d) at its centre; held nodes do not move."""
        p, radius, function = self.problem, self.settings.enrichment_radius, self.settings.function
        coefficients = change.T / functions.slope_at_point(function, radius)
        term = EnrichmentTerm.build(centre, radius, coefficients, p.factorization, p.evaluator, function=function)
        self.terms.append(term)
        self.positions = np.where(p.held[:, None], self.positions, self.positions + term.displacement(p.start))


def explicit_iterations(
    problem: CorrectionProblem, settings: ExplicitSettings, standard: DisplacementField | None = None
) -> ExplicitResult:
    """Improve a motion with enrichment points until its prediction reaches the threshold.

    Parameters
    ----------
    problem : CorrectionProblem
    settings : ExplicitSettings
    standard : DisplacementField, optional
        The standard motion as a field from ``problem.start``; the predictors that use gradients need it.

    Raises
    ------
    InvalidInput
        If a gradient predictor is chosen without the field.
    """
    exact = settings.predictor == "trial-nodes"
    if standard is None and not exact:
        raise InvalidInput(f"the predictor {settings.predictor!r} needs the standard motion as a field")
    trial = _Trial(problem, settings, None if exact else standard, problem.standard)
    history, best, best_positions = [_iterate(trial)], 0, trial.positions
    while history[-1].predicted < settings.threshold and len(trial.terms) < settings.max_points:
        cell = history[-1].worst
        centre = problem.cells.centres(problem.start, np.array([cell]))[0]
        gradient = trial.gradient(cell, centre)
        if not np.isfinite(gradient).all():
            break  # the motion itself is not finite; no local change repairs that
        trial.add(centre, settings.relaxation * CELL_CORRECTIONS[settings.decomposition](gradient))
        history.append(_iterate(trial))
        if history[-1].predicted > history[best].predicted:
            best, best_positions = len(trial.terms), trial.positions
    d = problem.start.shape[1]
    return ExplicitResult(
        points=best_positions,
        enrichment_points=np.array([t.centre for t in trial.terms[:best]]).reshape(-1, d),
        coefficients=np.array([t.coefficients for t in trial.terms[:best]]).reshape(-1, d, d),
        best=best,
        reached=history[best].predicted >= settings.threshold,
        history=tuple(history),
    )


def _iterate(trial: _Trial) -> Iterate:
    """Judge the trial."""
    predicted = trial.prediction().metric(trial.settings.metric)
    actual = predicted if trial.standard is None else trial.actual().metric(trial.settings.metric)
    worst = worst_cell(predicted)
    return Iterate(float(predicted[worst]), float(actual.min()), worst)


def mean_gradient(before: Floats, after: Floats, cells: CellTable, cell: int) -> Floats:
    """(d, d) displacement gradient of a cell from its nodes: exact for simplices, the least-squares fit for others."""
    block, row = cells.locate(cell)
    nodes = block.nodes[row]
    x, y = before[nodes] - before[nodes].mean(axis=0), after[nodes] - after[nodes].mean(axis=0)
    return np.asarray(np.linalg.lstsq(x, y - x, rcond=None)[0].T)
