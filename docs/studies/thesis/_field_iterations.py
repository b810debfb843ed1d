"""Explicit iterations that predict with the gradients of the displacement field, as the thesis does (§5.3).

The exact prediction is the server's own: :mod:`mesh_motion_numerics.correction.enrichment.explicit_iterations`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mesh_motion_numerics.correction.correction_problem import CorrectionProblem
from mesh_motion_numerics.correction.enrichment import functions
from mesh_motion_numerics.correction.enrichment.explicit_iterations import (
    ExplicitResult,
    ExplicitSettings,
    Iterate,
    Trial,
    explicit_iterations,
)
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import Factorization
from mesh_motion_numerics.interpolation.two_scale.interpolant import AnyInterpolant
from numpy.typing import NDArray

from docs.studies.thesis._predictors import DisplacementField, predict

__all__ = ["EnrichmentTerm", "FieldTrial", "SumField", "predicted_iterations"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EnrichmentTerm:
    """``H(x) C − Σ_b γ_b φ``: an enrichment point's displacement, zero at the control points; thesis (5.15), (5.16)."""

    centre: Floats
    radius: float
    coefficients: Floats
    compensation: AnyInterpolant
    function: str = "H1"

    @classmethod
    def build(
        cls,
        centre: Floats,
        radius: float,
        coefficients: Floats,
        factorization: Factorization,
        *,
        function: str = "H1",
    ) -> EnrichmentTerm:
        """The term with coefficients (d, d) at a centre (d,)."""
        at_boundary = functions.values(function, factorization.control_points, centre, radius) @ coefficients
        return cls(centre, radius, coefficients, factorization.solve(-at_boundary), function)

    def displacement(self, points: Floats) -> Floats:
        """(n, d) displacement of points (n, d)."""
        own = functions.values(self.function, points, self.centre, self.radius) @ self.coefficients
        return np.asarray(own + evaluation.displacement(self.compensation, points))

    def gradient(self, points: Floats) -> Floats:
        """(n, d, d) gradient, ``[:, i, j] = ∂S_i/∂x_j``."""
        own = functions.gradients(self.function, points, self.centre, self.radius)
        return np.asarray(
            np.einsum("nmj,mi->nij", own, self.coefficients) + evaluation.gradient(self.compensation, points)
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


class FieldTrial(Trial):
    """Predicts from a standard motion, a field from ``problem.start``, and the terms of the points added to it."""

    def __init__(
        self, problem: CorrectionProblem, settings: ExplicitSettings, standard: DisplacementField, predictor: str
    ) -> None:
        super().__init__(problem, settings, problem.standard)
        self._predictor, self._field = predictor, SumField((standard,))

    def judged(self) -> Iterate:
        p = self.problem
        found = predict(self._predictor, p.start, p.cells, p.reference_sizes, self._field).metric(self.settings.metric)
        worst = int(np.argmin(found))
        return Iterate(float(found[worst]), float(self.actual().min()), worst)

    def gradient(self, cell: int, centre: Floats) -> Floats:
        del cell
        return np.asarray(self._field.gradient(centre[None])[0])

    def add(self, centre: Floats, change: Floats) -> None:
        super().add(centre, change)
        p, radius, function = self.problem, self.settings.enrichment_radius, self.settings.function
        coefficients = self.terms[-1][1]
        term = EnrichmentTerm.build(centre, radius, coefficients, p.factorization, function=function)
        self._field = SumField((*self._field.fields, term))


def predicted_iterations(
    problem: CorrectionProblem,
    settings: ExplicitSettings,
    standard: DisplacementField,
    predictor: str = "centre-gradient",
) -> ExplicitResult:
    """The explicit iterations with one of :data:`~docs.studies.thesis._predictors.PREDICTORS`."""
    if predictor == "trial-nodes":
        return explicit_iterations(problem, settings)
    return explicit_iterations(problem, settings, FieldTrial(problem, settings, standard, predictor))
