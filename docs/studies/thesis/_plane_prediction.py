"""Shared parts of the studies of Figs. 3.8 to 3.11 and A.1 (triangles) and 3.12 to 3.15 and A.2 (quads)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from mesh_motion_numerics.quality.metrics import cell_quality

from docs.studies.study import Cell, Picture, Table
from docs.studies.thesis._prediction import (
    COLOURS,
    SHORT,
    Errors,
    Floats,
    Mesh,
    draw_cells,
    draw_slopes,
    errors,
    order_table,
    polygons,
    predicted_errors,
    qualities,
    rigid,
)
from docs.studies.thesis._predictors import InterpolantField

#: The thesis' formulas (3.21) and (3.24) multiply size and skew without a root.
METRIC = "size-skew-product"
GRADIENTS = ("centre-gradient", "edge-midpoint-gradient")
RADIUS = 0.4

#: Relative errors (3.13) are taken of cells that are at least so good: where quality passes zero they say nothing.
GOOD = 0.2


@dataclass(frozen=True)
class PlaneCase:
    """A family of plane meshes with halved edges, and the motion of the thesis' figures."""

    mesh: Callable[[int], Mesh]
    direction: tuple[float, float]
    shift: float
    degrees: float
    centre: tuple[float, float]

    def field(self, mesh: Mesh, shift: float | None = None, degrees: float | None = None) -> InterpolantField:
        """The interpolant of all boundary nodes of a mesh."""
        moved = np.array(self.direction) * (self.shift if shift is None else shift)
        turn = self.degrees if degrees is None else degrees
        body = rigid(mesh.points[mesh.body], turn, np.array(self.centre), moved)
        return mesh.field(body, RADIUS)


def convergence(case: PlaneCase, levels: int, *, fixed_field: bool) -> dict[str, list[Errors]]:
    """Errors on refined meshes; with ``fixed_field`` all meshes use the field of the coarsest mesh's boundary nodes."""
    found: dict[str, list[Errors]] = {name: [] for name in GRADIENTS}
    coarse = case.field(case.mesh(0))
    for level in range(levels):
        mesh = case.mesh(level)
        field = coarse if fixed_field else case.field(mesh)
        for name in GRADIENTS:
            found[name].append(predicted_errors(name, mesh, field, METRIC))
    return found


Convergence = dict[str, list[Errors]]


def convergences(case: PlaneCase, levels: int, figure: str) -> tuple[Convergence, Convergence, list[Table]]:
    """Errors with all boundary nodes and in a fixed field, and the tables of both; ``figure`` of the thesis."""
    every, fixed = (convergence(case, levels, fixed_field=one) for one in (False, True))
    captions = (
        f"**{figure}.** Control points: all boundary nodes of each mesh, as in the thesis.",
        "The same meshes in one and the same field: that of the coarsest mesh's boundary nodes.",
    )
    labels: list[Cell] = [str(len(case.mesh(level).cells)) for level in range(levels)]
    return every, fixed, [order_table("cells", labels, *one) for one in zip((every, fixed), captions, strict=True)]


def magnitudes(case: PlaneCase, shifts: tuple[float, ...], turns: tuple[float, ...]) -> Table:
    """Figs. 3.11 and 3.15: the coarsest mesh, translation alone and rotation alone."""
    mesh = case.mesh(0)
    rows: list[list[Cell]] = []
    motions = [(s, 0.0) for s in shifts] + [(0.0, t) for t in turns]
    for shift, turn in motions:
        field = case.field(mesh, shift, turn)
        found = qualities(mesh, field)
        actual = found["trial-nodes"].metric(METRIC)
        good = actual >= GOOD
        row: list[Cell] = [f"{shift:g}", f"{turn:g}°", float(actual.min())]
        for name in GRADIENTS:
            predicted = found[name].metric(METRIC)
            e = errors(predicted, actual)
            row += [errors(predicted[good], actual[good]).relative, e.largest, e.rmse]
        rows.append(row)
    columns = ["displacement", "rotation", "actual minimum"]
    for name in GRADIENTS:
        columns += [f"{SHORT[name]}: relative (3.13)", f"{SHORT[name]}: max", f"{SHORT[name]}: RMSE"]
    caption = f"{len(mesh.cells)} cells; relative errors over the cells whose quality stays at or above {GOOD:g}."
    return Table(columns, rows, caption, digits=3)


def maps(case: PlaneCase, levels: int, caption: str) -> Picture:
    """Figs. A.1 and A.2: actual above predicted on the undeformed grid, one column a mesh, and the deformed mesh."""

    def draw(figure: Any) -> None:
        axes = figure.subplots(2, levels)
        for level in range(levels):
            mesh = case.mesh(level)
            found, corners = qualities(mesh, case.field(mesh)), polygons(mesh, mesh.points)
            for row, name, what in ((0, "trial-nodes", "actual"), (1, "centre-gradient", "predicted")):
                values = found[name].metric(METRIC)
                title = f"{what}, {len(mesh.cells)} cells\nminimum {values.min():.3f}"
                shown = draw_cells(axes[row, level], corners, values, title)
        figure.colorbar(shown, ax=axes, shrink=0.7, label="size-skew, product")

    return Picture(draw, caption, (6.8, 4.6))


def deformed(case: PlaneCase, level: int, caption: str) -> Picture:
    """Figs. 3.8 and 3.12: the actual quality on the undeformed and on the deformed grid; and the predictors' errors."""

    def draw(figure: Any) -> None:
        axes = figure.subplots(2, 2)
        mesh = case.mesh(level)
        field = case.field(mesh)
        moved = mesh.points + field.displacement(mesh.points)
        actual = cell_quality(moved, mesh.cells, mesh.sizes).metric(METRIC)
        draw_cells(axes[0, 0], polygons(mesh, mesh.points), actual, "actual, undeformed grid")
        shown = draw_cells(axes[0, 1], polygons(mesh, moved), actual, "actual, deformed grid")
        figure.colorbar(shown, ax=axes[0], shrink=0.8, label="size-skew, product")
        found = qualities(mesh, field)
        for ax, name in zip(axes[1], GRADIENTS, strict=True):
            off = np.abs(found[name].metric(METRIC) - actual)
            title = f"|predicted − actual|, {SHORT[name]}: at most {off.max():.3f}"
            shown = draw_cells(ax, polygons(mesh, mesh.points), off, title, (0.0, 0.1))
        figure.colorbar(shown, ax=axes[1], shrink=0.8, label="difference", extend="max")

    return Picture(draw, caption, (8.0, 7.4))


def slopes(all_nodes: dict[str, list[Errors]], fixed: dict[str, list[Errors]], caption: str) -> Picture:
    """Figs. 3.10 and 3.14 with reference slopes, for the thesis' control points and for a fixed field."""

    def draw(figure: Any) -> None:
        for ax, found, title in zip(
            figure.subplots(1, 2, sharey=True),
            (all_nodes, fixed),
            ("control points: all boundary nodes of each mesh", "control points: those of the coarsest mesh"),
            strict=True,
        ):
            count = len(found[GRADIENTS[0]])
            h = 0.5 ** np.arange(count)
            curves: dict[str, tuple[Floats, str, str]] = {}
            for name in GRADIENTS:
                for what, style in (("largest", "o--"), ("rmse", "s-")):
                    label = f"{SHORT[name]}, {'RMSE' if what == 'rmse' else 'largest'}"
                    curves[label] = (np.array([getattr(e, what) for e in found[name]]), COLOURS[name], style)
            last = found["edge-midpoint-gradient"][-1].rmse
            draw_slopes(ax, h, curves, {1: 0.6 * found["centre-gradient"][-1].rmse, 2: 0.6 * last})
            ax.set_title(title, fontsize=9)
            ax.set_ylabel("error of the size-skew product")
            ax.legend(fontsize=7)

    return Picture(draw, caption, (10.0, 4.2))
