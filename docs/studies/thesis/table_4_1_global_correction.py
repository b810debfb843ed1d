"""Table 4.1 and Figs 4.4 to 4.9: one global enrichment point in the middle, with each of the three functions."""

from __future__ import annotations

from typing import Any

import numpy as np
from mesh_motion_numerics.correction.enrichment import functions

from docs.studies.study import Cell, Outcome, Picture, Study, Table
from docs.studies.thesis._line import FINE, NODES, Line, draw_displacement, draw_parts, predicted, sizes, smallest

FUNCTIONS = ("H1", "H2", "H3")
MIDDLE = np.array([0.5])

#: Table 4.1: R → standard (the thesis prints the prediction), then H1, H2, H3.
PRINTED = {
    0.2: (-0.373, 0.262, 0.091, -0.006),
    0.3: (-0.056, 0.379, 0.284, 0.242),
    0.4: (0.2185, 0.346, 0.328, 0.329),
}


def run(quick: bool) -> Outcome:
    rows: list[list[Cell]] = []
    for radius, (standard, *enriched) in PRINTED.items():
        line = Line(support_radius=radius)
        plain = line.solve()
        rows.append([radius, "standard", standard, float(predicted(plain).min()), smallest(plain)])
        for function, printed in zip(FUNCTIONS, enriched, strict=True):
            found = line.solve(MIDDLE, function=function)
            rows.append([radius, function, printed, float(predicted(found).min()), smallest(found)])
    table = Table(("R", "motion", "thesis", "predicted", "actual"), rows, "Minimum size, R_l = 1, J = −0.5.", digits=5)
    wide = [0.2, 0.3, 0.4, 0.6, 1.0, 2.0][: 4 if quick else 6]
    more: list[list[Cell]] = [
        [
            radius,
            smallest(Line(support_radius=radius).solve()),
            *(smallest(Line(support_radius=radius).solve(MIDDLE, function=f)) for f in FUNCTIONS),
        ]
        for radius in wide
    ]
    beyond = Table(
        ("R", "standard", *FUNCTIONS), more, "Fig 4.9, and larger radii: actual minimum size (the optimum is 0.5)."
    )
    return Outcome(
        (table, beyond), (Picture(_functions, "Figs 4.4, 4.9.", (9, 3.4)), Picture(_effects, _EFFECTS, (9.5, 7.5)))
    )


_EFFECTS = "Figs 4.5 to 4.8: size of the cells before the motion, displacements, and their parts; R = 0.4."


def _functions(figure: Any) -> None:
    """Fig 4.4, and the bars of Fig 4.9."""
    left, right = figure.subplots(1, 2)
    for kind in FUNCTIONS:
        h = functions.values(kind, FINE[:, None], np.array([0.5]), 1.0)[:, 0]
        left.plot(FINE, h / np.abs(h).max(), label=kind)
    left.set(xlabel="x", ylim=(-1.1, 1.45), title="enrichment functions, scaled to 1; R_l = 1")
    left.legend(fontsize=8, ncols=3, loc="upper center")
    radii = list(PRINTED)
    for place, kind in enumerate(("standard", *FUNCTIONS)):
        heights = []
        for radius in radii:
            line = Line(support_radius=radius)
            heights.append(smallest(line.solve() if place == 0 else line.solve(MIDDLE, function=kind)))
        right.bar(np.arange(3) + 0.2 * place - 0.3, heights, 0.18, label=kind)
    right.set(title="minimum size", ylim=(-0.4, 0.5))
    right.set_xticks(range(3), [f"R = {radius}" for radius in radii])
    right.axhline(0, color="k", lw=0.6)
    right.legend(fontsize=7, ncols=2)


def _effects(figure: Any) -> None:
    line = Line()
    axes = figure.subplots(3, 3)
    plain = line.solve()
    for row, kind in zip(axes, FUNCTIONS, strict=True):
        found = line.solve(MIDDLE, function=kind)
        centres = 0.5 * (NODES[1:] + NODES[:-1])
        row[0].plot(centres, sizes(plain), ".-", label="standard")
        row[0].plot(centres, sizes(found), ".-", label=kind)
        row[0].set(title=f"{kind}: size", ylim=(0, 2.2))
        row[0].legend(fontsize=7)
        draw_displacement(row[1], line, {"standard": plain, kind: found})
        draw_parts(row[2], line, found)


def claims(outcome: Outcome) -> None:
    for radius, motion, printed, before, actual in outcome.tables[0].rows:
        ours = before if motion == "standard" else actual  # which of the two the thesis prints
        assert abs(float(ours) - float(printed)) < 1e-3, (radius, motion)
    for row in outcome.tables[1].rows:
        assert row[2] == max(row[1:5]) < 0.4


STUDY = Study(
    "Which enrichment function gives the best mesh with one point in the middle of the gap?",
    "Table 4.1, Figs 4.4–4.9 (equations 4.1–4.8)",
    run,
    claims,
    (
        "mesh_motion_numerics.correction.enrichment.imposed_gradient.solve_imposed_gradient",
        "mesh_motion_numerics.correction.enrichment.functions.ENRICHMENT_FUNCTIONS",
    ),
)
