"""Thesis (3.8) to (3.12): the quality after many steps from the gradients of all of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from mesh_motion_numerics.quality.metrics import reference_sizes

from docs.studies.study import Cell, Outcome, Picture, Study, Table
from docs.studies.thesis._many_steps import AccumulatedGradients, predict_many_steps
from docs.studies.thesis._prediction import (
    Curves,
    Floats,
    Mesh,
    draw_slopes,
    errors,
    line,
    order,
    rigid,
    thesis_triangles,
)
from docs.studies.thesis._predictors import InterpolantField, centre_positions

STEPS = (1, 4, 16)
METRIC = "size-skew-product"


def steps_of(mesh: Mesh, body: list[Floats], radius: float) -> list[InterpolantField]:
    """The interpolant of every relative step, from the present boundary to the next position of the body."""
    fields, points = [], mesh.points.copy()
    for where in body:
        now = Mesh(points, mesh.cells, mesh.outer, mesh.body)
        fields.append(now.field(where - points[mesh.body], radius))
        points = points.copy()
        points[mesh.body] = where
    return fields


def approach(mesh: Mesh, count: int) -> list[InterpolantField]:
    """1D: both inner boundaries come 0.15 closer, in equal steps."""
    start = mesh.points[mesh.body]
    displacement = np.array([[0.15], [-0.15]])
    return steps_of(mesh, [start + displacement * k / count for k in range(1, count + 1)], 0.4)


def turn(mesh: Mesh, count: int) -> list[InterpolantField]:
    """2D: 0.1 upwards and 30° anticlockwise, in equal steps."""
    start, centre = mesh.points[mesh.body], np.array([0.5, 0.5])
    shares = [k / count for k in range(1, count + 1)]
    return steps_of(mesh, [start + rigid(start, 30 * t, centre, np.array([0.0, 0.1 * t])) for t in shares], 0.4)


def product_in_place(mesh: Mesh, steps: list[InterpolantField]) -> Floats:
    """(m, d, d) the product (3.12) with every ∇S^i at the cell's first centre, which is wrong."""
    centres = centre_positions(mesh.points, mesh.cells)
    total = np.broadcast_to(np.eye(mesh.cells.dimension), (len(centres), *(mesh.cells.dimension,) * 2))
    for step in steps:
        total = np.einsum("nij,njk->nik", np.eye(mesh.cells.dimension) + step.gradient(centres), total)
    return total


def run(quick: bool) -> Outcome:
    """Errors in 1D and on triangles for 1, 4 and 16 steps."""
    lines = _lines((20, 40, 80) if quick else (20, 40, 80, 160, 320))
    plane = _plane(2 if quick else 4)
    return Outcome([lines, plane], [Picture(lambda f: _draw(f, lines, plane), "RMSE of the prediction over 16 steps.")])


def _lines(counts: tuple[int, ...]) -> Table:
    rows: list[list[Cell]] = []
    for n in counts:
        row: list[Cell] = [n]
        mesh = line(n)
        for count in STEPS:
            steps = approach(mesh, count)
            followed = AccumulatedGradients.of_cells(mesh.points, mesh.cells)
            moved = mesh.points
            for step in steps:
                followed, moved = followed.advance(step), moved + step.displacement(moved)
            actual = reference_sizes(moved, mesh.cells) / mesh.sizes
            row.append(errors(followed.deformation[:, 0, 0], actual).rmse)
        row.append(errors(product_in_place(mesh, steps)[:, 0, 0], actual).rmse)
        rows.append(row)
    columns = [
        "cells",
        *(f"{count} step{'s' * (count > 1)}" for count in STEPS),
        f"{STEPS[-1]} steps, centres not carried",
    ]
    caption = "**(3.12) in 1D**: RMSE of the size, displacement 0.15, R = 0.4."
    return Table(columns, [*rows, _orders(rows)], caption, digits=3)


def _plane(levels: int) -> Table:
    rows: list[list[Cell]] = []
    for level in range(levels):
        mesh = thesis_triangles(level)
        row: list[Cell] = [len(mesh.cells)]
        for name in ("centre-gradient", "edge-midpoint-gradient"):
            for count in STEPS[::2]:
                found = [
                    predict_many_steps(which, mesh.points, mesh.cells, mesh.sizes, turn(mesh, count)).metric(METRIC)
                    for which in (name, "trial-nodes")
                ]
                row.append(errors(*found).rmse)
        rows.append(row)
    columns = ["cells"]
    for name in ("centre", "edge midpoint"):
        columns += [f"{name}, {count} step{'s' * (count > 1)}" for count in STEPS[::2]]
    caption = "**Triangles**: RMSE of the size-skew product, 0.1 and 30°, R = 0.4."
    return Table(columns, [*rows, _orders(rows)], caption, digits=3)


def _orders(rows: list[list[Cell]]) -> list[Cell]:
    """The order of each column between the last two meshes."""
    last: list[Cell] = ["**order**, last refinement"]
    for coarse, fine in zip(rows[-2][1:], rows[-1][1:], strict=True):
        last.append(order(float(coarse or 0.0), float(fine or 0.0)))
    return last


def claims(outcome: Outcome) -> None:
    """Check that 16 steps have the order and the error of one step, and that they do not converge if centres stay."""
    lines, plane = outcome.tables
    one, _, many, in_place = lines.rows[-1][1:]
    assert all(1.9 < value < 2.1 for value in (one, many))
    assert abs(in_place) < 0.3
    assert lines.rows[-2][3] < 3.0 * lines.rows[-2][1]
    centre_one, centre_many, edge_one, edge_many = plane.rows[-1][1:]
    assert all(0.85 < value < 1.1 for value in (centre_one, centre_many))
    assert all(1.5 < value < 2.1 for value in (edge_one, edge_many))


def _draw(figure: Any, lines: Table, plane: Table) -> None:
    left, right = figure.subplots(1, 2)
    n = len(lines.rows) - 1
    curves: Curves = {
        "centres carried along": (_column(lines, 3), "#c1440e", "o-"),
        "not carried": (_column(lines, 4), "#808080", "s--"),
    }
    draw_slopes(left, 0.5 ** np.arange(n), curves, {2: 0.6 * _column(lines, 3)[-1]})
    left.set_title("1D, (3.12)", fontsize=9)
    n = len(plane.rows) - 1
    curves = {"centre": (_column(plane, 2), "#c1440e", "o-"), "edge midpoint": (_column(plane, 4), "#1b6ca8", "s-")}
    draw_slopes(right, 0.5 ** np.arange(n), curves, {1: 0.6 * _column(plane, 2)[-1], 2: 0.6 * _column(plane, 4)[-1]})
    right.set_title("triangles", fontsize=9)
    left.set_ylabel("RMSE")
    for ax in (left, right):
        ax.legend(fontsize=8)


def _column(table: Table, number: int) -> Floats:
    return np.array([row[number] for row in table.rows[:-1]])


STUDY = Study(
    title="Does the prediction over many steps stay as good as over one, with no node moved in between?",
    source="Equations (3.8) to (3.12)",
    run=run,
    claims=claims,
    functions=(
        "docs.studies.thesis._many_steps.AccumulatedGradients",
        "docs.studies.thesis._many_steps.predict_many_steps",
    ),
)
