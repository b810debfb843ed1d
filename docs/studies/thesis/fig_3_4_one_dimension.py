"""Thesis Figs. 3.4, 3.5, 3.6: the predicted size of 1D cells against the actual one."""

from __future__ import annotations

from typing import Any

import numpy as np
from mesh_motion_numerics.quality.metrics import reference_sizes

from docs.studies.study import Cell, Outcome, Picture, Study, Table
from docs.studies.thesis._prediction import Errors, Floats, errors, line, order
from docs.studies.thesis._predictors import centre_positions

RADII = (0.4, 1.0)
MAGNITUDES = (0.05, 0.10, 0.15)
COUNTS = (20, 40, 80, 160, 320)

#: Thesis Table 4.1, column of the standard method: it is the *predicted* minimum (R → value).
PRINTED = {0.2: -0.373, 0.3: -0.056, 0.4: 0.2185}


def sizes(cells: int, radius: float, magnitude: float) -> tuple[Floats, Floats, Floats]:
    """Cell centres, predicted size 1 + ∇S (3.7) and actual size (3.6), as the ratio that may exceed 1."""
    mesh = line(cells)
    field = mesh.field(np.array([[magnitude], [-magnitude]]), radius)
    centres = centre_positions(mesh.points, mesh.cells)
    actual = reference_sizes(mesh.points + field.displacement(mesh.points), mesh.cells) / mesh.sizes
    return centres[:, 0], 1.0 + field.gradient(centres)[:, 0, 0], actual


def run(quick: bool) -> Outcome:
    """Tables: minima next to the printed ones; errors over cells, radius and magnitude."""
    counts = COUNTS[:3] if quick else COUNTS
    found = {(r, m): [errors(*sizes(n, r, m)[1:]) for n in counts] for r in RADII for m in MAGNITUDES}
    tables = [_minima(), _convergence(counts, found), _magnitudes(found)]
    pictures = [
        Picture(
            _draw_profiles, "Figs. 3.4 and 3.5: predicted (circles) and actual (lines) size of each cell.", (9, 5.2)
        ),
        Picture(lambda f: _draw_errors(f, np.array(counts), found), "Fig. 3.6: errors against the number of cells."),
    ]
    return Outcome(tables, pictures)


def _minima() -> Table:
    rows: list[list[Cell]] = []
    for radius in (0.2, 0.3, 0.4, 1.0):
        _, predicted, actual = sizes(20, radius, 0.15)
        rows.append([radius, PRINTED.get(radius), float(predicted.min()), float(actual.min())])
    columns = ("R", "predicted minimum, thesis", "predicted minimum, ours", "actual minimum, ours")
    return Table(columns, rows, "20 cells, displacement 0.15: the smallest size.")


def _convergence(counts: tuple[int, ...], found: dict[tuple[float, float], list[Errors]]) -> Table:
    rows: list[list[Cell]] = []
    for i, n in enumerate(counts):
        row: list[Cell] = [str(n)]
        for radius in RADII:
            now = found[radius, 0.15][i]
            before = found[radius, 0.15][i - 1] if i else None
            row += [now.relative, now.rmse, order(before.rmse, now.rmse) if before else None]
        rows.append(row)
    columns = ["cells"]
    for radius in RADII:
        columns += [f"R = {radius:g}: largest relative error (3.13)", "RMSE (3.14)", "order of RMSE"]
    return Table(columns, rows, "Displacement 0.15.", digits=3)


def _magnitudes(found: dict[tuple[float, float], list[Errors]]) -> Table:
    rows: list[list[Cell]] = [
        [m, *(v for r in RADII for v in (found[r, m][0].relative, found[r, m][0].rmse))] for m in MAGNITUDES
    ]
    columns = ["displacement"] + [f"R = {r:g}: {what}" for r in RADII for what in ("largest relative error", "RMSE")]
    return Table(columns, rows, "20 cells.", digits=3)


def claims(outcome: Outcome) -> None:
    """Check the printed minima, second order, errors linear in the displacement and smaller with the larger radius."""
    minima, convergence, magnitudes = outcome.tables
    for _, printed, ours, _ in minima.rows:
        assert printed is None or abs(ours - printed) <= 0.0007  # the print cuts its digits instead of rounding
    last = convergence.rows[-1]
    assert 1.95 < last[3] < 2.05
    assert 1.95 < last[6] < 2.05
    assert all(row[2] > 2.5 * row[5] for row in convergence.rows)  # R = 0.4 against R = 1
    rmse = magnitudes.column("R = 0.4: RMSE")
    assert abs(rmse[2] / rmse[0] - 3.0) < 1e-6


def _draw_profiles(figure: Any) -> None:
    axes = figure.subplots(2, 2, sharex=True)
    cases = ((20, 0.4), (20, 1.0), (40, 0.4), (80, 0.4))
    for ax, (n, radius) in zip(axes.flat, cases, strict=True):
        x, predicted, actual = sizes(n, radius, 0.15)
        ax.plot(x, actual, "-", color="#202020", linewidth=1.2, label="actual, after moving the nodes")
        ax.plot(x, predicted, "o", color="#c1440e", markersize=4, fillstyle="none", label="predicted, 1 + ∇S")
        ax.axhline(1.0, color="#909090", linewidth=0.6)
        ax.set_title(f"{n} cells, R = {radius:g}", fontsize=9)
        ax.set_ylim(0.0, 2.0)
        ax.grid(True, linewidth=0.3)
    axes[0, 0].legend(fontsize=8, loc="upper center")
    for ax in axes[:, 0]:
        ax.set_ylabel("size, current / initial")
    for ax in axes[1]:
        ax.set_xlabel("cell centre")


def _draw_errors(figure: Any, counts: Any, found: dict[tuple[float, float], list[Errors]]) -> None:
    left, right = figure.subplots(1, 2, sharex=True)
    styles = {0.05: ":", 0.10: "--", 0.15: "-"}
    colours = {0.4: "#c1440e", 1.0: "#1b6ca8"}
    for (radius, magnitude), values in found.items():
        label = f"R = {radius:g}, displacement {magnitude:g}"
        kind = {
            "color": colours[radius],
            "linestyle": styles[magnitude],
            "marker": "o",
            "markersize": 3,
            "label": label,
        }
        left.loglog(counts, [v.relative for v in values], **kind)
        right.loglog(counts, [v.rmse for v in values], **kind)
    for ax, title in ((left, "largest relative error (3.13)"), (right, "RMSE (3.14)")):
        low = ax.get_ylim()[0]
        ax.loglog(counts, 2.0 * low * (counts[-1] / counts) ** 2.0, color="#808080", linewidth=1, label="slope −2")
        ax.set_title(title, fontsize=9)
        ax.set_xlabel("cells")
        ax.set_xticks(counts, labels=[str(n) for n in counts])
        ax.minorticks_off()
        ax.grid(True, which="major", linewidth=0.3)
    right.legend(fontsize=7)


STUDY = Study(
    title="How well does 1 + ∇S at the cell centre predict the size of a 1D cell?",
    source="Figs 3.4, 3.5 and 3.6, equations (3.6), (3.7), (3.13), (3.14)",
    run=run,
    claims=claims,
    functions=(
        "docs.studies.thesis._predictors.predict",
        "docs.studies.thesis._predictors.centre_positions",
        "mesh_motion_numerics.quality.metrics.reference_sizes",
    ),
)
