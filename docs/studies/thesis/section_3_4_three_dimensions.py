"""Thesis §3.4.1: prediction in 3D, which the thesis describes but does not test."""

from __future__ import annotations

from typing import Any

import numpy as np

from docs.studies.study import Cell, Outcome, Picture, Study, Table
from docs.studies.thesis._prediction import (
    COLOURS,
    PREDICTORS,
    SHORT,
    Errors,
    Floats,
    boxes,
    draw_slopes,
    order,
    predicted_errors,
    rigid,
)
from docs.studies.thesis._predictors import InterpolantField

KINDS = ("tetra", "hexahedron", "wedge", "pyramid")
GRADIENTS = PREDICTORS[:2]
METRIC = "size-skew-product"


def smooth_field() -> InterpolantField:
    """A cube turned by 20° about z and shifted, in a fixed outer cube: the interpolant of the coarsest mesh's nodes."""
    mesh = boxes("hexahedron", 5)
    body = rigid(mesh.points[mesh.body], 20.0, np.full(3, 0.5), np.array([0.08, 0.04, 0.06]))
    return mesh.field(body, 1.0)


def run(quick: bool) -> Outcome:
    """Errors of all predictors on four kinds of cells, edges halved from mesh to mesh."""
    counts = (5, 10) if quick else (5, 10, 20, 40)
    field = smooth_field()
    found = {
        (kind, name): [predicted_errors(name, boxes(kind, n), field, METRIC) for n in counts]
        for kind in KINDS
        for name in PREDICTORS
    }
    return Outcome([_table(counts, found)], [Picture(lambda f: _draw(f, counts, found), "Errors in 3D.", (10.0, 6.6))])


def _table(counts: tuple[int, ...], found: dict[tuple[str, str], list[Errors]]) -> Table:
    rows: list[list[Cell]] = []
    for kind in KINDS:
        for name in PREDICTORS:
            coarse, fine = found[kind, name][-2:]
            cells = len(boxes(kind, counts[-1]).cells)
            orders = order(coarse.largest, fine.largest), order(coarse.rmse, fine.rmse)
            rows.append([kind, str(cells), SHORT[name], fine.largest, fine.rmse, *orders])
    columns = ("cells", "finest mesh", "predictor", "largest error", "RMSE", "order of largest", "order of RMSE")
    return Table(columns, rows, "Error of the size-skew product (3.28), (3.30); orders over the last refinement.", 3)


def claims(outcome: Outcome) -> None:
    """Check orders: centre first on cells with triangles, second on hexahedra; edge midpoint second; nodes exact."""
    full = len({row[1] for row in outcome.tables[0].rows}) and int(outcome.tables[0].rows[0][1]) > 100_000
    slack = 0.15 if full else 0.45
    for kind, _, name, largest, rmse, _, rate in outcome.tables[0].rows:
        if name == "trial nodes":
            assert largest == rmse == 0.0
        else:
            first = name == "centre" and kind != "hexahedron"
            assert abs(float(rate or 0.0) - (1.0 if first else 2.0)) < slack, (kind, name, rate)


def _draw(figure: Any, counts: tuple[int, ...], found: dict[tuple[str, str], list[Errors]]) -> None:
    h = counts[0] / np.array(counts, dtype=np.float64)
    for ax, kind in zip(figure.subplots(2, 2, sharey=True).flat, KINDS, strict=True):
        curves: dict[str, tuple[Floats, str, str]] = {}
        for name in GRADIENTS:
            for what, style in (("largest", "o--"), ("rmse", "s-")):
                values = np.array([getattr(e, what) for e in found[kind, name]])
                curves[f"{SHORT[name]}, {'RMSE' if what == 'rmse' else 'largest'}"] = (values, COLOURS[name], style)
        anchors = {1: 0.6 * found[kind, GRADIENTS[0]][-1].rmse, 2: 0.6 * found[kind, GRADIENTS[1]][-1].rmse}
        if kind == "hexahedron":
            del anchors[1]
        draw_slopes(ax, h, curves, anchors)
        ax.set_title(kind, fontsize=9)
        ax.set_ylabel("error")
        ax.legend(fontsize=7)


STUDY = Study(
    title="With which order do the predictors converge on tetrahedra, hexahedra, wedges and pyramids?",
    source="§3.4.1, equations (3.25) to (3.30); the thesis prints no result in 3D",
    run=run,
    claims=claims,
    functions=(
        "docs.studies.thesis._predictors.predict",
        "mesh_motion_numerics.mesh.cells.CellType",
    ),
)
