"""Interpolation of boundaries whose spacing spans many orders of magnitude, with default settings."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.assembly import dense_block
from mesh_motion_numerics.interpolation.kernels import basis_named
from mesh_motion_numerics.interpolation.two_scale.factorization import TwoScaleFactorization
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.neighbours import local_spacing
from mesh_motion_numerics.mesh.points import padded
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.quality.metrics import cell_quality, cells_at_rest
from numpy.typing import NDArray

from docs.studies.aerofoil_grids import Grid, c_grid, o_grid, wing
from docs.studies.study import Cell, Outcome, Picture, Study, Table

Floats = NDArray[np.float64]

#: Name → grid, and the degrees that it turns by; all move by half a chord.
GRIDS: dict[str, tuple[Grid, float]] = {
    "C, cusped edge, far field 500": (c_grid("cusped", first=1e-5, far=500.0), 45.0),
    "C, sharp edge, far field 15": (c_grid("sharp", first=1e-3, far=15.0), 45.0),
    "C, sharp edge, first cells 1e-8, far field 1000": (c_grid("sharp", first=1e-8, far=1000.0), 45.0),
    "O, cusped edge, far field 50": (o_grid("cusped", first=1e-4, far=200.0), 45.0),
    "O, sharp edge, far field 250": (o_grid("sharp", first=1e-5, far=1000.0), 45.0),
    "O, blunt edge, first cells 1e-8, far field 250": (o_grid("blunt", first=1e-8, far=1000.0), 45.0),
    "wing, sharp edge, far field 4": (wing(o_grid("sharp", around=64, layers=28, first=1e-3, far=15.0)), 20.0),
    "wing, cusped edge, far field 250": (wing(o_grid("cusped", around=64, layers=28, first=1e-3, far=1000.0)), 20.0),
}


def measured(grid: Grid, degrees: float) -> list[Cell]:
    """A row: control nodes, their least spacing over R, condition of the matrix, error, quality and first cells."""
    cells = CellTable.from_arrays(grid.cells)
    model = MotionModel.build(grid.points, cells, grid.patches, Method(correction="none", allow_invalid=True))
    nodes, controls = model.roles.moving, model.roles.all
    targets = turned(grid.points[nodes], degrees)
    motion = model.move(grid.points, targets)
    wanted = grid.points.copy()
    wanted[nodes] = targets
    box = np.stack([grid.points.min(axis=0), grid.points.max(axis=0)])
    plan = model.standard_motion.plans[controls.tobytes()]
    found = plan.factorize(grid.points[controls], box[0], box[1])
    left = evaluation.displacement(found.solve((wanted - grid.points)[controls]), grid.points[controls])
    error = np.abs(left - (wanted - grid.points)[controls]).max() / np.abs(wanted - grid.points).max()
    quality = cell_quality(motion.points, cells, cells_at_rest(grid.points, cells))
    low, high = first_heights(grid, motion.points)
    spacing = float(local_spacing(grid.points[controls]).min() / model.method.support_radius)
    relative = quality.relative_extremes()[0]
    return [len(controls), spacing, condition(found, model.method), float(error), relative, low, high]


def turned(points: Floats, degrees: float) -> Floats:
    """Points (n, d) turned about the quarter chord in the x–y plane, and half a chord higher."""
    a, moved = np.radians(degrees), points.copy()
    x, y = points[:, 0] - 0.25, points[:, 1]
    moved[:, 0], moved[:, 1] = 0.25 + np.cos(a) * x - np.sin(a) * y, np.sin(a) * x + np.cos(a) * y + 0.5
    return moved


def condition(found: TwoScaleFactorization, method: Method) -> float:
    """Condition of the coarse matrix, from its eigenvalues."""
    assert method.support_radius is not None  # the model replaced 0 by 2.5 L
    points = padded(found.coarse.control_points)
    matrix = dense_block(basis_named(method.basis), method.support_radius, points, points)
    values = np.linalg.eigvalsh(matrix)
    return float(values[-1] / max(values[0], np.finfo(float).tiny))


def first_heights(grid: Grid, moved: Floats) -> tuple[float, float]:
    """Least and largest ratio of the lengths of first edges to their lengths at rest."""
    (nodes,) = grid.cells.values()
    on_body = np.isin(nodes, grid.body)
    pairs = (
        [(0, 1), (1, 2), (2, 3), (3, 0)]
        if nodes.shape[1] == 4
        else [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)]
    )
    ratios = []
    for a, b in pairs:
        up = on_body[:, a] != on_body[:, b]
        before, after = (
            np.linalg.norm(points[nodes[up, a]] - points[nodes[up, b]], axis=1) for points in (grid.points, moved)
        )
        ratios.append(after / before)
    every = np.concatenate(ratios)
    return float(every.min()), float(every.max())


def run(quick: bool) -> Outcome:
    """A row a grid."""
    chosen = list(GRIDS.items())[1::4] if quick else list(GRIDS.items())
    rows: list[list[Cell]] = [[name, *measured(grid, degrees)] for name, (grid, degrees) in chosen]
    columns = (
        "grid", "control nodes", "least spacing / R", "condition of the coarse matrix", "error before nodes are set",
        "smallest relative skew", "first cells, least", "largest",
    )  # fmt: skip
    name, (grid, degrees) = list(GRIDS.items())[1]
    caption = f"{name}, at rest and turned by {degrees:g}°."
    return Outcome([Table(columns, rows, digits=3)], [Picture(partial(draw, grid=grid, degrees=degrees), caption)])


def draw(figure: Any, grid: Grid, degrees: float) -> None:
    """The grid near the body, before and after."""
    cells = CellTable.from_arrays(grid.cells)
    model = MotionModel.build(grid.points, cells, grid.patches, Method(correction="none"))
    motion = model.move(grid.points, turned(grid.points[model.roles.moving], degrees))
    quads = grid.cells["quad"]
    for axes, points in zip(figure.subplots(1, 2), (grid.points, motion.points), strict=True):
        outline = points[np.hstack([quads, quads[:, :1]])]
        near = np.abs(outline - [0.5, 0.0]).max(axis=(1, 2)) < 2.5
        axes.plot(*np.moveaxis(outline[near], 2, 0).swapaxes(1, 2), color="0.3", linewidth=0.3)
        axes.set(aspect="equal", xlim=(-0.7, 1.7), ylim=(-1.2, 1.2))


def claims(outcome: Outcome) -> None:
    """Check errors at control nodes (1e-10 of the largest displacement) and the height of first cells (to 1.5 %)."""
    (table,) = outcome.tables
    assert max(table.column("error before nodes are set")) < 1e-10
    assert min(table.column("smallest relative skew")) > 0.7
    assert min(table.column("first cells, least")) > 0.985
    assert max(table.column("largest")) < 1.015


STUDY = Study(
    title="Is every boundary interpolated, whatever its spacing?",
    source="The thesis has one matrix of all boundary nodes",
    run=run,
    claims=claims,
    functions=(
        "mesh_motion_numerics.interpolation.two_scale.factorization.TwoScalePlan",
        "mesh_motion_numerics.interpolation.two_scale.compact_levels.levels_below",
        "mesh_motion_numerics.interpolation.support_radius.suggest_support_radius",
    ),
)
