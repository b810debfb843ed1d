"""Lowest quality over the support radius on three of the examples, without correction and with the default one."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from mesh_motion_protocol.errors import QualityRefused

from docs.studies.beyond.default_radii import Motion, frame
from docs.studies.moved_bodies import Turn, stored
from docs.studies.study import Cell, Outcome, Picture, Study, Table

#: Name → mesh, motion in one step from the reference mesh.
CASES: dict[str, tuple[str, Motion]] = {
    "block, 30° and (−0.1, −0.1)": ("examples/thesis_rotation/mesh", Turn((-0.1, -0.1), 30.0)),
    "flag, tip up by 80 mm": ("examples/turek_hron_flag/mesh", frame("turek_hron_flag", 7)),
    "wing, the whole bend and twist": ("examples/tapered_wing/mesh", frame("tapered_wing", 9)),
}
#: R over the longest side of the domain.
RADII = (0.1, 0.2, 0.3, 0.5, 1.0, 2.5)
CORRECTIONS = ("none", "optimised")


def lowest(name: str, correction: str, share: float | None) -> float:
    """Minimum size-skew; negative where the mesh would be invalid. None: the server's own radius."""
    path, motion = CASES[name]
    mesh = stored(path)
    radius = None if share is None else share * float(np.ptp(mesh.points, axis=0).max())
    invalid = {"allow_invalid": True} if correction == "none" else {}
    model = mesh.model(correction=correction, support_radius=radius, correction_target="threshold", **invalid)
    try:
        return float(model.move(model.points, motion(model.points[model.roles.moving])).corrected.metric.min)
    except QualityRefused as refusal:
        return float("nan") if refusal.best is None else refusal.best


def run(quick: bool) -> Outcome:
    """One row for each case and correction; the last column is the chosen radius."""
    names, radii = (list(CASES)[:1], RADII[1::2]) if quick else (list(CASES), RADII)
    rows: list[list[Cell]] = [
        [name, correction, *(lowest(name, correction, share) for share in (*radii, None))]
        for name in names
        for correction in CORRECTIONS
    ]
    columns = ("motion, one step", "correction", *(f"R = {share:g} L" for share in radii), "default R")
    caption = "Lowest size-skew over the radius; dashed: without correction. L is the domain's longest side."
    picture = Picture(partial(draw, rows=rows, radii=radii), caption, size=(8.0, 3.8))
    return Outcome([Table(columns, rows, digits=2)], [picture])


def draw(figure: Any, rows: list[list[Any]], radii: tuple[float, ...]) -> None:
    """A colour a case."""
    axes = figure.subplots()
    for number, (name, correction, *found) in enumerate(rows):
        plain = correction == "none"
        label = None if plain else name
        axes.plot(radii, found[: len(radii)], "--" if plain else "-", marker=".", color=f"C{number // 2}", label=label)
    axes.axhline(0.2, color="0.6", linewidth=0.8)
    axes.set_xscale("log")
    axes.set_xticks(radii, [f"{share:g}" for share in radii])
    axes.set_xlabel("R / L")
    axes.set_ylabel("lowest size-skew")
    axes.set_ylim(bottom=-0.5)
    axes.legend(fontsize=8)


def claims(outcome: Outcome) -> None:
    """Check that corrected motions stay above the threshold, and plain ones are not best with the smallest radius."""
    for _, correction, *found in outcome.tables[0].rows:
        if correction == "optimised":
            assert min(found) >= 0.2 - 1e-9
        else:
            assert found[0] < max(found)


STUDY = Study(
    title="How much does the support radius matter?",
    source="Support radius",
    run=run,
    claims=claims,
    functions=("mesh_motion_numerics.motion.motion.MotionModel",),
)
