"""Predicted quality of every cell against its actual one after the nodes have moved."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from numpy.typing import NDArray

from docs.studies.moved_bodies import Turn, stored
from docs.studies.study import Outcome, Picture, Study, Table
from docs.studies.thesis._predictors import InterpolantField, predict

Floats = NDArray[np.float64]

MESH = "examples/thesis_rotation/mesh"
MOTION = Turn((-0.1, -0.1), 30.0)
PREDICTORS = ("trial-nodes", "edge-midpoint-gradient", "centre-gradient")


@cache
def predictions() -> dict[str, tuple[Floats, Floats]]:
    """Predictor → predicted and actual size-skew (m,)."""
    mesh = stored(MESH)
    block, outer = mesh.patches["block"].nodes, mesh.patches["outer"].nodes
    centres = np.concatenate([block, outer])
    displacement = np.zeros_like(mesh.points)
    displacement[block] = MOTION(mesh.points[block]) - mesh.points[block]
    sizes = reference_sizes(mesh.points, mesh.cells)
    found = factorize(mesh.points[centres], support_radius=0.5).solve(displacement[centres])
    field = InterpolantField(found)
    points = mesh.points + evaluation.displacement(found, mesh.points)
    actual = cell_quality(points, mesh.cells, sizes).metric("size-skew")
    return {
        name: (predict(name, mesh.points, mesh.cells, sizes, field).metric("size-skew"), actual) for name in PREDICTORS
    }


def run(quick: bool) -> Outcome:
    """How far each is off."""
    del quick
    rows = []
    for name, (predicted, actual) in predictions().items():
        error = np.abs(predicted - actual)
        rows.append([name, float(predicted.min()), float(actual.min()), float(error.max()), float(error.mean())])
    columns = ("predictor", "lowest predicted", "lowest actual", "largest error", "mean error")
    caption = "Each cell's predicted quality over its actual one."
    return Outcome([Table(columns, rows, digits=3)], [Picture(draw, caption, size=(9.0, 3.3))])


def draw(figure: Any) -> None:
    """Draw one cloud for each predictor; on the line the prediction is exact."""
    for axes, (name, (predicted, actual)) in zip(figure.subplots(1, 3), predictions().items(), strict=True):
        axes.plot(actual, predicted, ".", markersize=2.0)
        axes.plot([0, 1], [0, 1], color="0.5", linewidth=0.8)
        axes.set_title(name, fontsize=9)
        axes.set_xlabel("actual")
        axes.set_aspect("equal")
    figure.axes[0].set_ylabel("predicted")


def claims(outcome: Outcome) -> None:
    """Check that trial nodes are exact to rounding, and gradients are not."""
    errors = outcome.tables[0].column("largest error")
    assert errors[0] < 1e-12
    assert min(errors[1:]) > 1e-3


STUDY = Study(
    title="Is the actual quality equal to the predicted one?",
    source="Prediction",
    run=run,
    claims=claims,
    functions=("docs.studies.thesis._predictors.predict",),
)
