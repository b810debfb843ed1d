"""Thesis §6.2.1: prediction by groups of cells, and the best size of a group."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_numerics.interpolation.interpolant import Interpolant
from mesh_motion_numerics.mesh.cells import CellTable

from docs.studies.study import Cell, Outcome, Picture, Study, Table
from docs.studies.thesis._prediction import Floats, Mesh, boxes, rigid, thesis_triangles
from docs.studies.thesis._predictors import InterpolantField, predict
from docs.studies.thesis._sampling import BOUNDS, ExpandableField, predict_sampled
from docs.studies.thesis._sampling.groups import group_cells

SIZES = (8, 32, 128, 256)
THRESHOLD = 0.2
METRIC = "size-skew"


def large(name: str) -> Mesh:
    """A mesh of the comparison with other systems, built by Gmsh: 196 k triangles or 296 k tetrahedra."""
    from benchmarks.peers.meshes import load_or_build  # noqa: PLC0415 needs gmsh, and takes seconds

    built = load_or_build(name, Path(tempfile.gettempdir()) / "mesh-motion-studies")
    return Mesh(built.points, CellTable.from_arrays(built.cells), built.fixed, built.moving)


def moved(mesh: Mesh) -> InterpolantField:
    """One large step: (−0.2, −0.2) and 60° in 2D, −0.15 in y and 30° about z in 3D; R = 0.5."""
    plane = mesh.cells.dimension == 2
    shift = np.array([-0.2, -0.2]) if plane else np.array([0.0, -0.15, 0.0])
    centre = np.full(mesh.cells.dimension, 0.5)
    return mesh.field(rigid(mesh.points[mesh.body], 60.0 if plane else 30.0, centre, shift), 0.5)


def run(quick: bool) -> Outcome:
    """Cost and certainty over the size of a group; and a random sample, as in the thesis."""
    meshes: dict[str, Callable[[], Mesh]] = {"plane, 6656 triangles": lambda: thesis_triangles(2)}
    if not quick:
        meshes |= {
            "plane, 196 k triangles": lambda: large("M2"),
            "space, 48 k tetrahedra": lambda: boxes("tetra", 20),
            "space, 296 k tetrahedra": lambda: large("M3"),
        }
    rows: list[list[Cell]] = []
    costs: dict[str, dict[str, list[tuple[int, float]]]] = {}
    samples: list[list[Cell]] = []
    for name, build in meshes.items():
        mesh = build()
        field = moved(mesh)
        exact, seconds = _reference(mesh, field, "trial-nodes")
        _, thesis = _reference(mesh, field, "centre-gradient")
        costs[name] = {"thesis": [(0, thesis / seconds)], **{bound: [] for bound in BOUNDS}}
        for bound in BOUNDS:
            for size in SIZES[1:3] if quick else SIZES:
                row, cost = _by_groups(mesh, field, exact, size, bound)
                rows.append([name, bound, str(size), *row, cost / seconds, cost / thesis])
                costs[name][bound].append((size, cost / thesis))
        samples += _random(name, exact)
    columns: Sequence[str] = (
        "mesh", "bound", "cells a group", "in full", "nodes needed", "bad missed", "bounds broken",
        "cost / trial nodes", "cost / centre gradient",
    )  # fmt: skip
    caption = "CPU time of one prediction with given groups; all bad cells (size-skew < 0.2) are counted."
    found = Table(columns, rows, caption, digits=3)
    columns = ("mesh", "cells sampled", "cost / all cells", "share of bad cells", "chance to see none", "minimum",
               "median minimum of the sample", "cells to see one at 99 %")  # fmt: skip
    random = Table(columns, samples, "The thesis' form: random cells and exact prediction.", digits=3)
    return Outcome(
        [found, random],
        [
            Picture(
                lambda f: _draw(f, costs),
                "Cost by the size of a group; dotted: trial nodes, the exact prediction.",
                (9.0, 4.2),
            )
        ],
    )


def _reference(mesh: Mesh, field: InterpolantField, name: str) -> tuple[Floats, float]:
    """The metric of every cell by a predictor, and its CPU seconds, the shorter of two runs."""
    best, values = np.inf, np.empty(0)
    for _ in range(2):
        began = time.process_time()
        values = predict(name, mesh.points, mesh.cells, mesh.sizes, field).metric(METRIC)
        best = min(best, time.process_time() - began)
    return values, best


def _by_groups(mesh: Mesh, field: InterpolantField, exact: Floats, size: int, bound: str) -> tuple[list[Cell], float]:
    """Share of cells evaluated in full, share of nodes, missed cells, broken bounds, CPU seconds."""
    assert isinstance(field.interpolant, Interpolant)
    groups = group_cells(mesh.points, [block.nodes for block in mesh.cells], size)
    best = np.inf
    for _ in range(2):
        began = time.process_time()
        found = predict_sampled(
            mesh.points,
            mesh.cells,
            mesh.sizes,
            ExpandableField(field.interpolant),
            lambda nodes: field.displacement(mesh.points[nodes]),
            metric=METRIC,
            threshold=THRESHOLD,
            groups=groups,
            bound=bound,
        )
        best = min(best, time.process_time() - began)
    missed = int(np.count_nonzero((exact < THRESHOLD) & ~found.in_full))
    broken = int(np.count_nonzero(found.least > exact))
    return [float(found.in_full.mean()), found.nodes / len(mesh.points), missed, broken], best


def _random(name: str, exact: Floats) -> list[list[Cell]]:
    """Share of random samples without a bad cell, median of their worst quality, and the necessary number of cells."""
    rng = np.random.default_rng(1)
    rows: list[list[Cell]] = []
    for count in (10, 100, 1000):
        minima = [exact[rng.integers(0, len(exact), count)].min() for _ in range(400)]
        none = float(np.mean(np.array(minima) >= THRESHOLD))
        share = float(np.mean(exact < THRESHOLD))
        needed = int(np.ceil(np.log(0.01) / np.log1p(-share))) if share > 0.0 else None
        least = float(exact.min())
        rows.append([name, str(count), count / len(exact), share, none, least, float(np.median(minima)), needed])
    return rows


def claims(outcome: Outcome) -> None:
    """Check that no bad cell is missed and no certain bound is broken, for any size of a group."""
    for row in outcome.tables[0].rows:
        assert row[5] == 0, row
        if row[1] == "certain":
            assert row[6] == 0, row
    chances = outcome.tables[1].column("chance to see none")
    assert chances[2] == 0.0
    minima = outcome.tables[1].column("minimum")
    assert all(a <= b for a, b in zip(minima, outcome.tables[1].column("median minimum of the sample"), strict=True))


def _draw(figure: Any, costs: dict[str, dict[str, list[tuple[int, float]]]]) -> None:
    for ax, bound in zip(figure.subplots(1, 2, sharey=True), BOUNDS, strict=True):
        for (name, found), colour in zip(costs.items(), ("#c1440e", "#8c6d1f", "#1b6ca8", "#3a7d44"), strict=False):
            size, cost = np.array(found[bound]).T
            ax.loglog(size, cost, "o-", color=colour, markersize=4, label=name)
            ax.axhline(1.0 / found["thesis"][0][1], color=colour, linestyle=":", linewidth=1)
        ax.axhline(1.0, color="#202020", linewidth=0.8)
        ax.set_title(f"{bound} bound", fontsize=9)
        ax.set_xticks(SIZES, labels=[str(size) for size in SIZES])
        ax.minorticks_off()
        ax.set_xlabel("cells a group")
        ax.grid(True, linewidth=0.3)
    figure.axes[0].set_ylabel("CPU time / centre gradient of every cell")
    figure.axes[0].legend(fontsize=7)


STUDY = Study(
    title="Does it pay to predict groups of cells, and how large should a group be?",
    source="§6.2.1, future work; the thesis prints no result",
    run=run,
    claims=claims,
    functions=(
        "docs.studies.thesis._sampling.predict_sampled",
        "docs.studies.thesis._sampling.expansion.expand",
        "docs.studies.thesis._sampling.remainder.remainders",
        "docs.studies.thesis._sampling.cell_bounds.bounded_quality",
    ),
)
