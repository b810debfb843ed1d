"""A block that turns and moves in one step: the plain interpolation and the corrected motion, cell by cell."""

from __future__ import annotations

from typing import Any

import numpy as np
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from numpy.typing import NDArray

from docs.studies.moved_bodies import Turn, moved, stored
from docs.studies.study import Outcome, Picture, Study, Table

Floats = NDArray[np.float64]

MESH = "examples/thesis_rotation/mesh"
MOTION = Turn((-0.2, -0.2), 60.0)
METHODS: dict[str, dict[str, Any]] = {
    "plain interpolation": {"correction": "none", "allow_invalid": True},
    "enrichment": {"correction": "enrichment", "correction_target": "maximum"},
    "optimised (default)": {"correction": "optimised"},
}
SHOWN = ("plain interpolation", "optimised (default)")


def after(name: str) -> tuple[Floats, Floats]:
    """Nodes (n, 2) and size-skew (m,) after the motion with a method."""
    mesh = stored(MESH)
    model = mesh.model(support_radius=0.5, **METHODS[name])
    points = moved(model, MOTION).points
    return points, cell_quality(points, mesh.cells, reference_sizes(mesh.points, mesh.cells)).metric("size-skew")


def run(quick: bool) -> Outcome:
    """A row a method."""
    del quick
    rows = []
    for name in METHODS:
        _, quality = after(name)
        rows.append([name, float(quality.min()), int((quality <= 0.0).sum()), float(quality.mean())])
    table = Table(("method", "lowest size-skew", "inverted cells", "mean"), rows, digits=3)
    caption = "The same step without and with correction; inverted cells are pink."
    return Outcome([table], [Picture(draw, caption, size=(9.0, 4.3))])


def draw(figure: Any) -> None:
    """Both meshes, coloured by quality."""
    triangles = stored(MESH).cells.blocks[0].nodes
    for axes, name in zip(figure.subplots(1, 2), SHOWN, strict=True):
        points, quality = after(name)
        shown = axes.tripcolor(*points.T, triangles, quality, cmap="viridis", vmin=0.0, vmax=1.0, edgecolors="0.3",
                               linewidth=0.15)  # fmt: skip
        if (bad := quality <= 0.0).any():
            axes.tripcolor(*points.T, triangles[bad], np.ones(int(bad.sum())), cmap="spring", vmin=1.0, vmax=2.0)
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_title(f"{name}: lowest {quality.min():.2f}", fontsize=10)
    figure.colorbar(shown, ax=figure.axes, shrink=0.8, label="size-skew")


def claims(outcome: Outcome) -> None:
    """Check that plain interpolation inverts cells, both corrections none, and that the default is best."""
    plain, enriched, optimised = outcome.tables[0].rows
    assert plain[2] > 0
    assert enriched[2] == optimised[2] == 0
    assert optimised[1] >= enriched[1] > 0.2


STUDY = Study(
    title="A block turns by 60° and moves by a fifth of the domain in both directions, in one step",
    source="Correction",
    run=run,
    claims=claims,
    functions=("mesh_motion_numerics.motion.motion.MotionModel",),
)
