"""A large turn in one move: refused in one step, reached in legs."""

from __future__ import annotations

from typing import Any

import numpy as np
from mesh_motion_protocol.errors import QualityRefused

from docs.studies.beyond.valid_wherever import subject, turned
from docs.studies.study import Cell, Outcome, Picture, Study, Table

MESH = "grid of quads"
DEGREES = (120.0, 180.0)


def lowest(degrees: float, **choices: Any) -> float | None:
    """Minimum size-skew after a turn about the middle in one move; None if the move is refused."""
    mesh = subject(MESH)
    model = mesh.model(**choices)
    try:
        return float(model.move(model.points, turned(mesh, degrees)).corrected.metric.min)
    except QualityRefused:
        return None


def run(quick: bool) -> Outcome:
    """A row an angle."""
    del quick
    rows: list[list[Cell]] = []
    for degrees in DEGREES:
        found = [lowest(degrees, correction="none"), lowest(degrees, sub_steps="never"), lowest(degrees)]
        rows.append([f"{degrees:.0f}°", *("refused" if value is None else value for value in found)])
    columns = ("turn in one move", "plain interpolation", "corrected, one step", "default: sub-steps if one step fails")
    caption = "A grid whose body has turned by half a turn, in one move."
    return Outcome([Table(columns, rows, digits=3)], [Picture(draw, caption, size=(4.8, 4.6))])


def draw(figure: Any) -> None:
    """The mesh after the last turn."""
    mesh = subject(MESH)
    model = mesh.model()
    points = model.move(model.points, turned(mesh, DEGREES[-1])).points
    axes = figure.subplots()
    corners = mesh.cells.blocks[0].nodes
    for quad in points[np.concatenate([corners, corners[:, :1]], axis=1)]:
        axes.plot(*quad.T, color="0.3", linewidth=0.6)
    axes.set_aspect("equal")
    axes.set_axis_off()


def claims(outcome: Outcome) -> None:
    """Check that half a turn is refused in one step, even with correction, and reached in legs."""
    third, half = outcome.tables[0].rows
    assert third[1] == half[1] == half[2] == "refused"
    assert third[2] == third[3] > 0.5
    assert half[3] > 0.3


STUDY = Study(
    title="How far may a body turn in one move?",
    source="Sub-steps",
    run=run,
    claims=claims,
    functions=("mesh_motion_numerics.motion.sub_steps.walk",),
)
