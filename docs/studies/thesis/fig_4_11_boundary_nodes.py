"""Figs 4.10 to 4.13: two local enrichment functions at the moving boundary nodes, and their ideal gradient."""

from __future__ import annotations

from typing import Any

import numpy as np
from mesh_motion_numerics.correction.enrichment import functions

from docs.studies.study import Cell, Outcome, Picture, Study, Table
from docs.studies.thesis._line import FINE, Line, best_slope, draw_displacement, draw_parts, smallest

RADII = (0.2, 0.3, 0.4, 0.5, 0.6, 0.8)
SHOWN = (0.2, 0.4, 0.6)
PLACES = np.array([0.2, 0.8])

#: The statements of §4.3.2 on each radius: sign of the ideal gradient, and whether it helps.
SAID = {0.2: "negative", 0.4: "no improvement", 0.6: "positive", 0.8: "positive"}


def run(quick: bool) -> Outcome:
    slopes = np.linspace(-1.0, 1.0, 41 if quick else 201)  # the thesis' step, 0.01
    rows: list[list[Cell]] = []
    standard = smallest(Line().solve())
    for radius in RADII:
        slope, reached = best_slope(Line(enrichment_radius=radius), PLACES, slopes)
        rows.append([radius, SAID.get(radius), slope, reached, reached - standard])
    columns = ("R_l", "thesis, in words", "ideal gradient", "minimum size", "gain")
    caption = f"Fig 4.11a: gradient imposed at both moving nodes, R = 0.4, d_b = 0.15; standard motion {standard:.4f}."
    sweep = Table(columns, rows, caption)
    moves = np.linspace(0.03, 0.18, 3 if quick else 6)
    linear = [[float(move), *_ideal(float(move), slopes)] for move in moves]
    caption = "Fig 4.11b: ideal gradient by the deformation's magnitude."
    magnitude = Table(("d_b", *(f"R_l = {r}" for r in (0.2, 0.6, 0.8))), linear, caption, digits=3)
    pictures = (
        Picture(lambda figure: _sweeps(figure, slopes), "Figs 4.10 and 4.11.", (9.5, 3.2)),
        Picture(lambda figure: _results(figure, slopes), "Figs 4.12 and 4.13: with the ideal gradient.", (9.5, 5.6)),
    )
    return Outcome((sweep, magnitude), pictures)


def _ideal(move: float, slopes: Any) -> list[float]:
    return [
        best_slope(Line(moves=(move, -move), enrichment_radius=radius), PLACES, slopes)[0] for radius in (0.2, 0.6, 0.8)
    ]


def _sweeps(figure: Any, slopes: Any) -> None:
    stitched, by_slope, by_move = figure.subplots(1, 3)
    pair = sum(functions.values("H1", FINE[:, None], np.array([place]), 0.6)[:, 0] for place in PLACES)
    whole = functions.values("H1", FINE[:, None], np.array([0.5]), 1.0)[:, 0]
    stitched.plot(FINE, pair / np.abs(pair).max(), label="two at the nodes, R_l = 0.6")
    stitched.plot(FINE, -whole / np.abs(whole).max(), "--", label="−(one in the middle), R_l = 1")
    stitched.set(title="stitched functions", ylim=(-1.1, 1.9))
    stitched.legend(fontsize=7, loc="upper left")
    for radius in (0.2, 0.4, 0.6, 0.8):
        line = Line(enrichment_radius=radius)
        by_slope.plot(slopes, [smallest(line.solve(PLACES, [s, s])) for s in slopes], label=f"R_l = {radius}")
    by_slope.axhline(smallest(Line().solve()), color="k", lw=0.8, ls=":")
    by_slope.set(xlabel="imposed gradient", title="minimum size", ylim=(-0.4, 0.5))
    by_slope.legend(fontsize=7)
    moves = np.linspace(0.03, 0.18, 6)
    ideal = np.array([_ideal(float(move), slopes) for move in moves])
    by_move.plot(moves, ideal, ".-", label=["R_l = 0.2", "R_l = 0.6", "R_l = 0.8"])
    by_move.set(xlabel="d_b", title="ideal gradient")
    by_move.legend(fontsize=7)


def _results(figure: Any, slopes: Any) -> None:
    top, bottom = figure.subplots(2, 3)
    lines = [Line(enrichment_radius=radius) for radius in SHOWN]
    found = [line.solve(PLACES, [best_slope(line, PLACES, slopes)[0]] * 2) for line in lines]
    top[0].bar(range(4), [smallest(Line().solve()), *(smallest(f) for f in found)], 0.6)
    top[0].set_xticks(range(4), ["standard", *(f"R_l = {r}" for r in SHOWN)], fontsize=7)
    top[0].set_title("minimum size")
    draw_displacement(top[1], Line(), {"standard": Line().solve()})
    draw_displacement(top[2], Line(), {f"R_l = {r}": f for r, f in zip(SHOWN, found, strict=True)})
    for ax, line, f in zip(bottom, lines, found, strict=True):
        draw_parts(ax, line, f)
        ax.set_title(f"R_l = {line.enrichment_radius}")


def claims(outcome: Outcome) -> None:
    rows = {row[0]: row for row in outcome.tables[0].rows}
    assert float(rows[0.2][2]) < 0.0 < min(float(rows[0.6][2]), float(rows[0.8][2]))
    assert float(rows[0.4][4]) < 0.01 < min(float(rows[r][4]) for r in (0.2, 0.6, 0.8))
    moves = np.array(outcome.tables[1].rows, dtype=float)
    for column in (2, 3):  # linear in the displacement
        assert np.corrcoef(moves[:, 0], moves[:, column])[0, 1] > 0.98


STUDY = Study(
    "What do local enrichment functions at the boundary nodes give, and which gradient must be imposed there?",
    "Figs 4.10–4.13 (equations 4.9, 4.10)",
    run,
    claims,
    ("mesh_motion_numerics.correction.enrichment.imposed_gradient.solve_imposed_gradient",),
)
