"""Thesis Figs. 3.12 to 3.15 and A.2: predicted quality of quadrilaterals."""

from __future__ import annotations

from docs.studies.study import Cell, Outcome, Study, Table
from docs.studies.thesis._plane_prediction import (
    PlaneCase,
    convergence,
    convergences,
    deformed,
    magnitudes,
    maps,
    slopes,
)
from docs.studies.thesis._prediction import Mesh, boxes


def mesh(level: int) -> Mesh:
    """Structured quads around a square block; the coarsest is 11 × 11 nodes."""
    return boxes("quad", 10 * 2**level)


CASE = PlaneCase(mesh, (1.0, 0.0), 0.15, 15.0, (0.3, 0.5))


def run(quick: bool) -> Outcome:
    """Convergence with all boundary nodes and with a fixed field; magnitudes; maps."""
    levels = 4 if quick else 5
    every, fixed, tables = convergences(CASE, levels, "Fig. 3.14")
    tables += [_with_triangles(levels), magnitudes(CASE, (0.05, 0.1, 0.15, 0.2), (5.0, 10.0, 15.0, 20.0))]
    pictures = [
        maps(CASE, 2 if quick else 3, "Fig. A.2 (and 3.13): actual (above) and predicted (below, centre gradient)."),
        deformed(CASE, 1, "Fig. 3.12, and where the predictors err."),
        slopes(every, fixed, "Fig. 3.14: quads. Dotted: slopes of first and second order."),
    ]
    return Outcome(tables, pictures)


def _with_triangles(levels: int) -> Table:
    """The centre gradient on the same grids and motion, with quads and with each quad cut into two triangles."""
    halved = PlaneCase(lambda level: boxes("triangle", 10 * 2**level), (1.0, 0.0), 0.15, 15.0, (0.3, 0.5))
    quads, triangles = (convergence(case, levels, fixed_field=False)["centre-gradient"] for case in (CASE, halved))
    rows: list[list[Cell]] = []
    for level, (quad, triangle) in enumerate(zip(quads, triangles, strict=True)):
        rows.append([str(len(mesh(level).cells)), quad.rmse, triangle.rmse, triangle.rmse / quad.rmse])
    columns = ("quads", "RMSE on quads", "RMSE with each cut into two triangles", "ratio")
    return Table(columns, rows, "The same grids and motion in quads and in triangles, centre gradient.", digits=3)


def claims(outcome: Outcome) -> None:
    """Check second order in a smooth field; in the thesis' field the largest error falls more slowly than the RMSE."""
    every, fixed, ratio_table, sizes = outcome.tables
    _, centre_max, centre_rmse, edge_max, edge_rmse = fixed.rows[-1]
    assert min(centre_rmse, edge_rmse) > 1.75
    assert min(centre_max, edge_max) > 1.5
    ratios = ratio_table.column("ratio")
    assert min(ratios) > 1.5  # the thesis expects a quarter
    assert ratios == sorted(ratios)
    assert every.rows[-1][2] > every.rows[-1][1] + 0.5  # the thesis: "the rates are different"
    shifts, turns = sizes.column("centre: RMSE")[:4], sizes.column("centre: RMSE")[4:]
    assert shifts == sorted(shifts)
    assert turns == sorted(turns)


STUDY = Study(
    title="How well does the gradient at the centre predict the quality of quadrilaterals, and with which order?",
    source="Figs 3.12 to 3.15 and A.2, equations (3.23), (3.24)",
    run=run,
    claims=claims,
    functions=(
        "docs.studies.thesis._predictors.predict",
        "docs.studies.thesis._predictors.transformed_quality",
        "mesh_motion_numerics.quality.metrics.cell_quality",
    ),
)
