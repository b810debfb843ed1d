"""The enrichment functions about their point: zero there, zero beyond their radius, a slope in between."""

from __future__ import annotations

from typing import Any

import numpy as np
from mesh_motion_numerics.correction.enrichment.functions import slope_at_point, values

from docs.studies.study import Outcome, Picture, Study, Table

KINDS = ("H1", "H2", "H3")


def along(kind: str, places: Any) -> Any:
    """The first component on a line through the point, divided by its slope at the point."""
    points = np.stack([places, np.zeros_like(places)], axis=1)
    return values(kind, points, np.zeros(2), 1.0)[:, 0] / slope_at_point(kind, 1.0)


def run(quick: bool) -> Outcome:
    """The place at which each is largest."""
    del quick
    places = np.linspace(0.0, 1.0, 20_001)
    rows = []
    for kind in KINDS:
        curve = along(kind, places)
        top = int(np.argmax(curve))
        rows.append([kind, float(places[top]), float(curve[top])])
    caption = "The enrichment functions on a line through their point, with slope 1 there."
    table = Table(("function", "largest at, in R_l", "largest value, in R_l"), rows, digits=3)
    return Outcome([table], [Picture(draw, caption, size=(7.0, 3.2))])


def draw(figure: Any) -> None:
    """A curve each."""
    axes = figure.subplots()
    places = np.linspace(-1.2, 1.2, 600)
    for kind in KINDS:
        axes.plot(places, along(kind, places), label=kind)
    axes.set_xlabel("distance from the enrichment point / R_l")
    axes.set_ylabel("displacement / R_l")
    axes.legend(fontsize=9)


def claims(outcome: Outcome) -> None:
    """Check that the functions are zero at the point and beyond the radius, and that H1 reaches furthest."""
    for kind in KINDS:
        assert np.allclose(along(kind, np.array([0.0, 1.0, 1.5])), 0.0, atol=1e-12)
    furthest = outcome.tables[0].column("largest at, in R_l")
    assert furthest[0] == max(furthest)


STUDY = Study(
    title="What does an enrichment function add?",
    source="Enrichment, thesis (4.5)–(4.7)",
    run=run,
    claims=claims,
    functions=("mesh_motion_numerics.correction.enrichment.functions.values",),
)
