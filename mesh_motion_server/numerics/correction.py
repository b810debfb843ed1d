"""Corrections of a trial motion, chosen by name: from the standard trial positions to better ones, before any node moves."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import NumericalError
from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.evaluation import Evaluator
from mesh_motion_server.numerics.interpolant import Factorization
from mesh_motion_server.numerics.trial_nodes import TrialMesh, polish, reach

__all__ = ["Correction", "CorrectionProblem", "CorrectionSettings", "correct"]


@dataclass(frozen=True, eq=False)
class CorrectionProblem:
    """What a correction works on."""

    start: NDArray[np.float64]
    standard: NDArray[np.float64]
    held: NDArray[np.bool_]
    cells: CellTable
    reference_sizes: NDArray[np.float64]
    factorization: Factorization
    evaluator: Evaluator


@dataclass(frozen=True)
class CorrectionSettings:
    """How to correct."""

    correction: str
    quality_metric: str
    quality_threshold: float
    target: str
    enrichment_radius: float
    max_enrichment_points: int


@dataclass(frozen=True, eq=False)
class Correction:
    """Corrected trial positions and what was done."""

    points: NDArray[np.float64]
    method: str
    enrichment_points: NDArray[np.float64]
    freed_nodes: int = 0
    iterations: int = 0
    reached: bool = True
    history: tuple[object, ...] = field(default=())


def correct(problem: CorrectionProblem, settings: CorrectionSettings) -> Correction:
    """Correct where the standard motion is below the threshold."""
    mesh = TrialMesh(problem.start, problem.cells, problem.reference_sizes, problem.held, settings.quality_metric)
    minimum = float(mesh.quality(problem.standard).min())
    none = np.empty((0, problem.start.shape[1]))
    if minimum >= settings.quality_threshold or settings.correction == "none":
        return Correction(problem.standard, "none", none, reached=minimum >= settings.quality_threshold)
    everything = settings.target != "threshold" and np.count_nonzero(~problem.held) <= 20_000
    if everything:
        found = polish(problem.standard, mesh, mesh.free(~problem.held))
    else:
        found = reach(problem.standard, mesh, settings.quality_threshold)
    if found.minimum <= 0:
        worst = np.argsort(mesh.quality(found.points), kind="stable")[:10]
        raise NumericalError("no valid mesh found", best=found.minimum, cells=worst.tolist())
    return Correction(
        found.points, "trial-nodes", none, found.freed, found.iterations, found.minimum >= settings.quality_threshold
    )
