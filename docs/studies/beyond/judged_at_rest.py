"""The reference of quality and correction: an ideal cell, or the same cell at rest."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.quality.metrics import cell_quality, cells_at_rest
from numpy.typing import NDArray

from docs.studies.aerofoil_grids import o_grid
from docs.studies.moved_bodies import StoredMesh, Turn, stored
from docs.studies.study import Cell, Outcome, Picture, Study, Table

Floats = NDArray[np.float64]
METRICS = ("size-skew", "relative-size-skew")


def even() -> StoredMesh:
    """The thesis' triangles."""
    return stored("examples/thesis_rotation/mesh")


def poor() -> StoredMesh:
    """The same mesh with randomly displaced interior nodes; all cells are valid, the worst has a skew near 0.1."""
    mesh, rng = even(), np.random.default_rng(1)
    free = np.ones(len(mesh.points), dtype=bool)
    for patch in mesh.patches.values():
        free[patch.nodes] = False
    points = mesh.points.copy()
    for node in np.flatnonzero(free):
        trial = points.copy()
        trial[node] += rng.uniform(-0.02, 0.02, 2)
        quality = cell_quality(trial, mesh.cells, np.ones(len(mesh.cells)))
        if quality.skew.min() > 0.1 and not quality.inverted.any():
            points = trial
    return StoredMesh(points, mesh.cells, mesh.patches)


def layered(kind: str) -> StoredMesh:
    """An O-grid with first cells of 1e-5 in a domain of two chords, as quads, as triangles, or both."""
    grid = o_grid("blunt", around=96, layers=32, first=1e-5, far=8.0)
    quads = grid.cells["quad"]
    split = {"quads": len(quads), "triangles": 0, "hybrid": 20 * 96}[kind]
    rest = quads[split:]
    cells = {"quad": quads[:split], "triangle": np.concatenate([rest[:, [0, 1, 2]], rest[:, [0, 2, 3]]])}
    patches = {"body": Patch("moving", grid.body), "far": Patch("fixed", grid.far)}
    return StoredMesh(grid.points, CellTable.from_arrays(cells), patches)


SLAB, SMALL = Turn((-0.2, -0.2), 60.0), Turn((-0.02, -0.02), 6.0)
NEAR, FAR = Turn((0.0, 0.1), 15.0), Turn((0.0, 0.5), 75.0)
#: Name → mesh and motion.
CASES: dict[str, tuple[Callable[[], StoredMesh], Turn]] = {
    "even triangles, small": (even, SMALL),
    "even triangles, large": (even, SLAB),
    "poor triangles, small": (poor, SMALL),
    "poor triangles, large": (poor, SLAB),
    "stretched quads, small": (partial(layered, "quads"), NEAR),
    "stretched quads, large": (partial(layered, "quads"), FAR),
    "stretched triangles, small": (partial(layered, "triangles"), NEAR),
    "stretched triangles, large": (partial(layered, "triangles"), FAR),
    "hybrid, small": (partial(layered, "hybrid"), NEAR),
    "hybrid, large": (partial(layered, "hybrid"), FAR),
}


def measured(name: str, metric: str) -> list[Cell]:
    """A row: plain and corrected minimum of the metric, relative skew, size and size-skew, first edges, seconds."""
    make, turn = CASES[name]
    mesh = make()
    model = MotionModel.build(
        mesh.points, mesh.cells, mesh.patches, Method(quality_metric=metric, correction="optimised")
    )
    motion = model.move(mesh.points, turn(mesh.points[model.roles.moving]))
    quality = cell_quality(motion.points, mesh.cells, cells_at_rest(mesh.points, mesh.cells))
    low = _lowest_edge(mesh, motion.points)
    own = [motion.standard.metric.min, motion.corrected.metric.min, *quality.relative_extremes()]
    return [*own, float(quality.metric("size-skew").min()), low, motion.seconds["total"]]


def _lowest_edge(mesh: StoredMesh, moved: Floats) -> float:
    """Least ratio of the length of an edge at the moving wall to its length at rest, or of the inverse ratio."""
    (body,) = (patch.nodes for patch in mesh.patches.values() if patch.role == "moving")
    pairs = []
    for block in mesh.cells:
        count = block.nodes.shape[1]
        pairs += [block.nodes[:, [k, (k + 1) % count]] for k in range(count)]
    edges = np.concatenate(pairs)
    edges = edges[np.isin(edges, body).sum(axis=1) == 1]
    before, after = (
        np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1) for points in (mesh.points, moved)
    )
    return float(np.minimum(after / before, before / after).min())


def run(quick: bool) -> Outcome:
    """Two rows for each case: judged and corrected by one metric or the other."""
    names = list(CASES)[:1] + list(CASES)[6:7] if quick else list(CASES)
    rows: list[list[Cell]] = [[name, metric, *measured(name, metric)] for name in names for metric in METRICS]
    columns = (
        "mesh, motion", "judged by", "its minimum, plain", "corrected", "smallest relative skew", "size", "size-skew",
        "first edges", "seconds",
    )  # fmt: skip
    caption = "Smallest relative skew of the corrected mesh, judged by either metric."
    return Outcome([Table(columns, rows, digits=3)], [Picture(partial(draw, rows=rows), caption, size=(9.0, 3.5))])


def draw(figure: Any, rows: list[list[Any]]) -> None:
    """A pair of bars for each case."""
    axes = figure.subplots()
    names = list(dict.fromkeys(row[0] for row in rows))
    for place, metric in enumerate(METRICS):
        values = [row[4] for row in rows if row[1] == metric]
        axes.bar(np.arange(len(names)) + 0.4 * place, values, width=0.38, label=metric)
    axes.set_xticks(np.arange(len(names)) + 0.2, names, rotation=25, ha="right", fontsize=7)
    axes.set_ylabel("smallest relative skew")
    axes.legend(fontsize=7)


def claims(outcome: Outcome) -> None:
    """Check that the metric relative to rest is not worse than the other one on meshes with layers or poor cells."""
    rows = {(row[0], row[1]): row for row in outcome.tables[0].rows}
    for name in dict.fromkeys(row[0] for row in outcome.tables[0].rows):
        ideal, rest = (rows[name, metric] for metric in METRICS)
        if "small" in name:
            assert rest[4] >= 0.98 * ideal[4]
            assert rest[3] >= rest[2]
        if "stretched" in name or "hybrid" in name:
            assert rest[7] > 0.99


STUDY = Study(
    title="Should cells be judged against an ideal cell, or against themselves at rest?",
    source="Beyond the thesis, whose skew is absolute",
    run=run,
    claims=claims,
    functions=(
        "mesh_motion_numerics.quality.metrics.cells_at_rest",
        "mesh_motion_numerics.correction.distortion.corner_simplices",
        "mesh_motion_numerics.motion.layered_walls.LayeredWalls",
    ),
)
