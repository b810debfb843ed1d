"""Does a boundary layer keep its thickness and stand upright on its wall, and what does that cost?"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mesh_motion_numerics.motion.boundary_layer import BoundaryLayer
from mesh_motion_numerics.motion.motion import MotionModel
from numpy.typing import NDArray

from docs.studies.beyond._layers import LayerMesh, bent_flag, bent_wing, in_triangles, stored_layer
from docs.studies.study import Cell, Outcome, Picture, Study, Table

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """A mesh, the bending of its body, the fractions of that motion, and the example's settings."""

    mesh: Callable[[], LayerMesh]
    bend: Callable[[Floats, float], Floats]
    fractions: tuple[float, ...]
    choices: dict[str, float]


_FLAG = {"support_radius": 0.4, "quality_threshold": 0.4}
_WING = {"support_radius": 1.0, "quality_threshold": 0.35}
CASES = {
    "flag, quads": Case(lambda: stored_layer("layer_flag"), bent_flag, (-1.0, 1.0), _FLAG),
    "flag, triangles": Case(lambda: in_triangles(stored_layer("layer_flag")), bent_flag, (-1.0, 1.0), _FLAG),
    "wing, prisms": Case(lambda: stored_layer("layer_wing"), bent_wing, (-0.5, 1.0), _WING),
}
CORRECTIONS = ("none", "optimised")


@dataclass
class _Found:
    """Points by fraction, the CPU seconds of all motions together, and control points."""

    points: dict[float, Floats]
    seconds: float
    controls: int


def run(quick: bool) -> Outcome:
    rows: list[list[Cell]] = []
    drawn: dict[str, Floats] = {}
    for body, case in CASES.items():
        mesh = case.mesh()
        fractions = case.fractions[-1:] if quick else case.fractions
        for correction in CORRECTIONS[: 1 if quick and body != "flag, quads" else 2]:
            model = mesh.model(correction=correction, **case.choices)
            models = {"without": replace(model, layered=None), "with": _carrying(model, mesh)}
            found = {name: _moved(model, case, fractions, repeats=1 if quick else 3) for name, model in models.items()}
            for name in models:
                ratio = found[name].seconds / found["without"].seconds
                rows.append([body, correction, name, *_measured(mesh, found[name]), ratio])
            if body == "flag, quads":
                drawn |= {f"{name} the layer, correction {correction}": found[name].points[1.0] for name in models}
    table = Table(_COLUMNS, rows, _TABLE, 3)
    return Outcome((table,), (Picture(lambda figure: _draw(figure, drawn), _CAPTION, (6.9, 2.4)),))


_COLUMNS = (
    "body",
    "correction",
    "the layer",
    "thickness, %",
    "orthogonality, °",
    "outer minimum",
    "minimum",
    "control points",
    "CPU",
)
_TABLE = (
    "Largest change of a layer node's distance from the wall, and of the angle between a column's edges and the wall's "
    "normal, without columns at edges of the wall; smallest size-skew outside the layer and of all cells, all over "
    "several positions; CPU time of these motions divided by that without a carried layer."
)
_CAPTION = "The tip of the flag at + 80 mm, without and with the layer carried."


def _carrying(model: MotionModel, mesh: LayerMesh) -> MotionModel:
    """The model; its wall moves the whole layer in each motion."""
    layer = BoundaryLayer.build(
        mesh.points, mesh.cells, mesh.patches, thickness=mesh.thickness, sliding=model.standard_motion.sliding
    )
    return replace(model, standard_motion=model.standard_motion.with_layer(layer), layered=None)


def _moved(model: MotionModel, case: Case, fractions: tuple[float, ...], repeats: int) -> _Found:
    """The motions from the reference mesh, and the shortest CPU time of all of them in some repeats."""
    start = model.points[model.roles.moving]
    seconds = []
    for _ in range(repeats):  # the first fills the caches
        before = time.process_time()
        motions = {fraction: model.move(model.points, case.bend(start, fraction)) for fraction in fractions}
        seconds.append(time.process_time() - before)
    points = {fraction: motion.points for fraction, motion in motions.items()}
    return _Found(points, min(seconds), len(motions[fractions[-1]].control_points))


def _measured(mesh: LayerMesh, found: _Found) -> list[Cell]:
    """A row: thickness, orthogonality, both minima, control points."""
    kept = [mesh.kept(points) for points in found.points.values()]
    return [
        100.0 * max(k.thickness for k in kept),
        max(k.orthogonality for k in kept),
        min(mesh.outer_minimum(points) for points in found.points.values()),
        min(mesh.minimum(points) for points in found.points.values()),
        found.controls,
    ]


def _draw(figure: Any, drawn: dict[str, Floats]) -> None:
    from matplotlib.collections import PolyCollection  # noqa: PLC0415

    mesh = stored_layer("layer_flag")
    shown = {name: points for name, points in drawn.items() if name != "with the layer, correction none"}
    for ax, (name, points) in zip(figure.subplots(1, len(shown)), shown.items(), strict=True):
        tip = points[mesh.body][np.argmax(mesh.points[mesh.body, 0])]
        low, high = tip - np.array([0.042, 0.034]), tip + np.array([0.02, 0.024])
        for block in mesh.cells:
            cells = points[block.nodes]
            near = ((cells < high) & (cells > low)).all(axis=2).any(axis=1)
            color = "#dfe9f3" if block.type.name == "quad" else "#ffffff"
            ax.add_collection(PolyCollection(cells[near], facecolors=color, edgecolors="#22303c", linewidths=0.4))
        ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        ax.set_title(name, fontsize=8)
        ax.set_axis_off()


def claims(outcome: Outcome) -> None:
    [table] = outcome.tables
    for row in table.rows:
        body, correction, layer, *numbers = row
        thickness, orthogonality, outer, _, controls, _ = (float(str(number)) for number in numbers)
        assert outer > 0.0, row
        if layer == "with":
            assert thickness <= 2.0, row
            assert orthogonality <= (20.0 if body == "flag, triangles" else 2.0), row  # see the page
            assert controls < 1.05 * float(str(_without(table, body, correction)[7])), row
        else:
            assert thickness > 5.0, row
            assert orthogonality > 10.0, row


def _without(table: Table, body: Cell, correction: Cell) -> list[Cell]:
    """The row of the same motion without the layer."""
    return next(list(row) for row in table.rows if tuple(row[:3]) == (body, correction, "without"))


STUDY = Study(
    "Does a boundary layer keep its thickness and stand upright on its wall, and what does that cost?",
    "Beyond the thesis, in which near-wall cells are interpolated like all others",
    run,
    claims,
    (
        "mesh_motion_numerics.motion.boundary_layer.BoundaryLayer",
        "mesh_motion_numerics.mesh.boundary_layer_wall.MovingWall",
        "mesh_motion_numerics.mesh.boundary_layer_nodes.layer_nodes",
        "mesh_motion_numerics.mesh.boundary_layer_stacks.column_feet",
    ),
)
