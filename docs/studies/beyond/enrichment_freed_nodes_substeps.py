"""Enrichment, freed nodes, sub-steps: the quality and the cost of each as a motion grows."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from mesh_motion_numerics.blas import one_blas_thread
from mesh_motion_numerics.correction.correction import correct
from mesh_motion_numerics.correction.correction_problem import CorrectionProblem
from mesh_motion_numerics.interpolation.factor_source import MakeEachTime
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.stopwatch import Stopwatch
from mesh_motion_protocol.errors import QualityRefused
from numpy.typing import NDArray

from docs.studies.moved_bodies import StoredMesh, Turn, stored
from docs.studies.refinement import refined
from docs.studies.study import Cell, Outcome, Picture, Study, Table

Floats = NDArray[np.float64]

#: Positions of the body's nodes (k, d) after a share of a motion of some size.
Path = Callable[[Floats, float], Floats]


@dataclass(frozen=True)
class Way:
    """A method: displacement, number of steps, and the correction of the last step."""

    displacement: str = "absolute"
    steps: int = 1
    correction: str = "none"


WAYS = {
    "standard": Way(),
    "5 steps": Way("relative", 5),
    "20 steps": Way("relative", 20),
    "reanchored": Way("reanchored"),
    "explicit": Way(correction="explicit"),
    "enrichment": Way(correction="enrichment"),
    "optimised": Way(correction="optimised"),
    "reanchored, optimised": Way("reanchored", correction="optimised"),
}
THRESHOLD = 0.2
TO_THRESHOLD = ("20 steps", "explicit", "enrichment", "optimised")
COLOURS = {
    "standard": "#999999",
    "20 steps": "#1b6ca8",
    "reanchored": "#6fb1dd",
    "explicit": "#7a5195",
    "enrichment": "#e0912f",
    "optimised": "#c1440e",
}


def shift(body: Floats, size: float) -> Floats:
    """To the left."""
    return body - size * np.eye(body.shape[1])[0]


def turn(body: Floats, size: float) -> Floats:
    """Turn by an angle in degrees; in 3D about the z axis."""
    return Turn((0.0,) * body.shape[1], size)(body)


def squeeze(body: Floats, size: float) -> Floats:
    """The parts left and right of the middle move towards each other."""
    return body + np.outer(np.where(body[:, 0] < 0.5, size, -size), np.eye(body.shape[1])[0])


def swell(body: Floats, size: float) -> Floats:
    """Scale by a factor 1 + size about the middle."""
    middle = (body.min(axis=0) + body.max(axis=0)) / 2.0
    return body + size * (body - middle)


@dataclass(frozen=True, eq=False)
class Series:
    """A growing motion of a mesh."""

    mesh: str
    stored: StoredMesh
    radius: float
    motion: str
    path: Path
    sizes: tuple[float, ...]


def series(quick: bool) -> list[Series]:
    """The variants that are compared."""
    block, two = stored("tests/references/thesis_block"), stored("tests/references/correction_two_blocks")
    box = stored("tests/references/correction_box")
    if quick:
        return [
            Series("triangles", block, 0.5, "shift", shift, (0.3,)),
            Series("triangles", block, 0.5, "turn", turn, (90.0,)),
            Series("triangles", two, 0.5, "squeeze", squeeze, (0.125,)),
        ]
    fine, hexahedra = refined(block, 2), stored("examples/hexahedral_box/mesh")
    return [
        Series("triangles", block, 0.5, "shift", shift, (0.1, 0.2, 0.3, 0.38)),
        Series("triangles", block, 0.5, "turn", turn, (45.0, 90.0, 135.0, 180.0)),
        Series("triangles", two, 0.5, "squeeze", squeeze, (0.05, 0.1, 0.125, 0.14)),
        Series("triangles, fine", fine, 0.5, "shift", shift, (0.3,)),
        Series("triangles, fine", fine, 0.5, "turn", turn, (60.0, 135.0)),
        Series("hexahedra", hexahedra, 0.8, "shift", shift, (0.2, 0.3)),
        Series("hexahedra", hexahedra, 0.8, "turn", turn, (45.0, 90.0, 135.0)),
        Series("hexahedra", hexahedra, 0.8, "swell", swell, (1.0, 1.5)),
        Series("tetrahedra", box, 0.5, "shift", shift, (0.15, 0.25, 0.35)),
        Series("tetrahedra", box, 0.5, "turn", turn, (45.0, 90.0, 135.0)),
        Series("tetrahedra", box, 0.5, "swell", swell, (1.0, 1.5)),
    ]


@dataclass(frozen=True)
class Reached:
    """Minimum size-skew, and the CPU seconds of the whole motion with every factorization repeated."""

    minimum: float
    seconds: float


def moved(one: Series, size: float, way: Way, threshold: float | None = None) -> Reached:
    """Run a motion: to the best quality of the method, or to a threshold."""
    model = one.stored.model(
        displacement=way.displacement, support_radius=one.radius, correction="none", allow_invalid=True
    )
    method = Method(
        correction=way.correction,
        quality_metric="size-skew",
        quality_threshold=0.95 if threshold is None else threshold,
        correction_target="maximum" if threshold is None else "threshold",
        enrichment_radius=one.radius,
    )
    body, points = model.points[model.roles.moving], model.points
    began = time.process_time()
    for step in range(1, way.steps + 1):
        targets = one.path(body, size * step / way.steps)
        trial = model.standard_motion.trial(points, targets, MakeEachTime(), Stopwatch())
        points = trial.points
    problem = CorrectionProblem(
        trial.start,
        trial.points,
        model.held,
        model.cells,
        model.reference_sizes,
        trial.factorization,
        model.points,
    )
    try:
        minimum = correct(problem, method).minimum
    except QualityRefused as refusal:
        minimum = float("-inf") if refusal.best is None else refusal.best
    return Reached(0.0 if abs(minimum) < 1e-9 else minimum, time.process_time() - began)


Found = list[tuple[Series, float, Mapping[str, Reached]]]


def run(quick: bool) -> Outcome:
    tried = series(quick)
    with one_blas_thread():
        for one in {each.stored.cells.blocks[0].type.name: each for each in tried[::-1]}.values():
            for way in WAYS.values():
                moved(one, 0.1 * one.sizes[0], way)  # what is loaded at the first call is no cost of a way
        found: Found = [
            (one, size, {name: moved(one, size, w) for name, w in WAYS.items()}) for one in tried for size in one.sizes
        ]
        hard = [(one, size) for one, size, reached in found if reached["standard"].minimum < THRESHOLD]
        to_threshold: Found = [
            (one, size, {name: moved(one, size, WAYS[name], THRESHOLD) for name in TO_THRESHOLD}) for one, size in hard
        ]
    tables = (_minima(found), _costs(found), _threshold_costs(to_threshold))
    pictures = () if quick else (Picture(lambda f: _draw(f, found), _CURVES, (9.5, 5.6)), _scatter(found))
    return Outcome(tables, pictures)


def _minima(found: Found) -> Table:
    rows: list[list[Cell]] = [
        [one.mesh, f"{one.motion} {size:g}", *(reached[name].minimum for name in WAYS)] for one, size, reached in found
    ]
    caption = (
        "Minimum size-skew of each method with its best settings: 20 enrichment points, target maximum. 0 or less: "
        "inverted cells."
    )
    return Table(("mesh", "motion", *WAYS), rows, caption, digits=3)


def _meshes(found: Found) -> dict[str, Found]:
    """By mesh."""
    return {name: [each for each in found if each[0].mesh == name] for name in dict.fromkeys(e[0].mesh for e in found)}


def _share(members: Found, name: str) -> float:
    """Mean of this way's quality divided by that of ``optimised``; 0 for an invalid mesh."""
    return float(np.mean([max(r[name].minimum, 0.0) / r["optimised"].minimum for _, _, r in members]))


def _milliseconds(members: Found, name: str) -> float:
    return 1e3 * float(np.mean([reached[name].seconds for _, _, reached in members]))


def _costs(found: Found) -> Table:
    rows: list[list[Cell]] = []
    for mesh, members in _meshes(found).items():
        nodes = len(members[0][0].stored.points)
        rows.append([mesh, nodes, "share of optimised", *(_share(members, name) for name in WAYS)])
        rows.append([mesh, nodes, "CPU ms", *(_milliseconds(members, name) for name in WAYS)])
    caption = "Means over the motions of a mesh; an invalid mesh counts as 0. The factorization is repeated each time."
    return Table(("mesh", "nodes", "mean", *WAYS), rows, caption, digits=3)


def _threshold_costs(found: Found) -> Table:
    rows: list[list[Cell]] = []
    for mesh, members in _meshes(found).items():
        reached = [
            f"{sum(r[name].minimum >= THRESHOLD for _, _, r in members)}/{len(members)}" for name in TO_THRESHOLD
        ]
        costs = [_milliseconds(members, name) for name in TO_THRESHOLD]
        rows.append([mesh, *(cell for pair in zip(reached, costs, strict=True) for cell in pair)])
    columns = [heading for name in TO_THRESHOLD for heading in (name, "CPU ms")]
    caption = f"To the threshold {THRESHOLD:g} only: motions that reach it, of those that start below it."
    return Table(("mesh", *columns), rows, caption, digits=3)


_CURVES = "Minimum size-skew of growing motions."


def _draw(figure: Any, found: Found) -> None:
    chosen = [
        ("triangles", "shift", "shift"),
        ("triangles", "turn", "turn, degrees"),
        ("triangles", "squeeze", "squeeze, each block"),
        ("triangles, fine", "turn", "turn, degrees"),
        ("hexahedra", "turn", "turn, degrees"),
        ("tetrahedra", "shift", "shift"),
    ]
    for ax, (mesh, motion, label) in zip(figure.subplots(2, 3).ravel(), chosen, strict=True):
        members = [each for each in found if (each[0].mesh, each[0].motion) == (mesh, motion)]
        for name, colour in COLOURS.items():
            values = [reached[name].minimum for _, _, reached in members]
            style = "o--" if name == "reanchored" else "o-"
            ax.plot([size for _, size, _ in members], values, style, ms=3, lw=1.3, color=colour, label=name)
        ax.axhline(0.0, color="k", lw=0.6)
        ax.set(title=mesh, xlabel=label, ylim=(-0.5, 1.0))
    for ax in figure.axes[::3]:
        ax.set_ylabel("minimum size-skew")
    _legend(figure)


def _legend(figure: Any) -> None:
    """One legend for all axes, below them."""
    figure.legend(*figure.axes[0].get_legend_handles_labels(), fontsize=8, ncols=6, loc="outside lower center")


def _decades(values: list[float]) -> tuple[float, float]:
    """Limits at whole powers of ten around positive values, so that every axis has ticks."""
    return float(10.0 ** np.floor(np.log10(min(values)))), float(10.0 ** np.ceil(np.log10(max(values))))


def _scatter(found: Found) -> Picture:
    def draw(figure: Any) -> None:
        groups = _meshes(found)
        axes = figure.subplots(1, len(groups), sharey=True, squeeze=False)[0]
        for ax, (mesh, members) in zip(axes, groups.items(), strict=True):
            costs = [_milliseconds(members, name) for name in COLOURS]
            for (name, colour), cost in zip(COLOURS.items(), costs, strict=True):
                ax.plot(cost, _share(members, name), "o", ms=7, color=colour, label=name)
            ax.set(xscale="log", title=mesh, xlabel="CPU ms a motion", ylim=(-0.05, 1.05), xlim=_decades(costs))
            ax.minorticks_off()
        figure.axes[0].set_ylabel("share of what freed nodes reach")
        _legend(figure)

    caption = "Quality that each method reaches over its CPU time: means over the motions of a mesh."
    return Picture(draw, caption, (9.5, 3.2))


def claims(outcome: Outcome) -> None:
    """Check that freed nodes are best, then optimised enrichment; sub-steps and explicit iterations are much worse."""
    for _, motion, *values in outcome.tables[0].rows:
        reached = {name: float(value or 0.0) for name, value in zip(WAYS, values, strict=True)}
        assert reached["optimised"] > 0.98 * max(reached.values()), motion
        assert reached["enrichment"] > max(reached["explicit"], reached["20 steps"], reached["standard"]), motion
        assert abs(reached["reanchored"] - reached["20 steps"]) < 0.06, motion
    for row in outcome.tables[2].rows:
        gets_there = {name: int(str(row[1 + 2 * k]).split("/")[0]) for k, name in enumerate(TO_THRESHOLD)}
        assert gets_there["optimised"] == max(gets_there.values()), row[0]


STUDY = Study(
    "When enrichment, when freed nodes, when sub-steps?",
    "Open: which correction for which motion and mesh",
    run,
    claims,
    (
        "mesh_motion_numerics.correction.correction.correct",
        "mesh_motion_numerics.motion.standard_motion.StandardMotion",
    ),
)
