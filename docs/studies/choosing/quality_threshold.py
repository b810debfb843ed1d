"""Cost of a threshold: freed nodes and time of the correction, on two of the examples."""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from typing import Any

from docs.studies.beyond.default_radii import Motion, frame
from docs.studies.moved_bodies import Turn, stored
from docs.studies.study import Cell, Outcome, Picture, Study, Table

#: Name → mesh, motion in one step from the reference mesh.
CASES: dict[str, tuple[str, Motion]] = {
    "block, 60° and (−0.2, −0.2)": ("examples/thesis_rotation/mesh", Turn((-0.2, -0.2), 60.0)),
    "wing, the whole bend and twist": ("examples/tapered_wing/mesh", frame("tapered_wing", 9)),
}
THRESHOLDS = (0.05, 0.1, 0.2, 0.3, 0.4)


def corrected(name: str, threshold: float) -> list[Cell]:
    """Plain and final quality, share of freed nodes, milliseconds of the correction."""
    path, motion = CASES[name]
    model = stored(path).model(quality_threshold=threshold, correction_target="threshold")
    positions = motion(model.points[model.roles.moving])
    model.move(model.points, positions)  # what is loaded once belongs to no threshold
    found = model.move(model.points, positions)
    share = found.correction.freed_nodes / len(model.points)
    return [found.standard.metric.min, found.corrected.metric.min, share, 1000.0 * found.seconds["correct"]]


def run(quick: bool) -> Outcome:
    """One row for each case and threshold."""
    names, thresholds = (list(CASES)[:1], THRESHOLDS[1::2]) if quick else (list(CASES), THRESHOLDS)
    rows: list[list[Cell]] = [[name, t, *corrected(name, t)] for name in names for t in thresholds]
    columns = ("motion, one step", "threshold", "plain", "reached", "share of nodes freed", "correction, ms")
    caption = "Left: lowest size-skew that the correction reached, over the threshold. Right: share of freed nodes."
    return Outcome([Table(columns, rows, digits=3)], [Picture(partial(draw, rows=rows), caption, size=(8.0, 3.3))])


def draw(figure: Any, rows: list[list[Any]]) -> None:
    """A colour a case."""
    left, right = figure.subplots(1, 2)
    for name in dict.fromkeys(row[0] for row in rows):
        mine = [row for row in rows if row[0] == name]
        left.plot([row[1] for row in mine], [row[3] for row in mine], marker=".", label=name)
        right.plot([row[1] for row in mine], [row[4] for row in mine], marker=".")
    left.plot([0, 0.45], [0, 0.45], color="0.6", linewidth=0.8)
    left.set_ylabel("lowest size-skew reached")
    right.set_ylabel("share of nodes freed")
    for axes in (left, right):
        axes.set_xlabel("quality_threshold")
    left.legend(fontsize=7)


def claims(outcome: Outcome) -> None:
    """Check that no motion ends below its plain quality, and that a higher threshold gives no lower quality."""
    rows = outcome.tables[0].rows
    for one, other in pairwise(rows):
        if one[0] == other[0]:
            assert other[3] >= one[3] - 1e-9
    assert all(row[3] >= row[1] - 1e-9 or row[1] > 0.4 for row in rows)


STUDY = Study(
    title="What does a threshold cost?",
    source="Quality threshold",
    run=run,
    claims=claims,
    functions=("mesh_motion_numerics.motion.motion.MotionModel",),
)
