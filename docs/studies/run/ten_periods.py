"""Ten periods of a motion in small steps: final quality of the mesh, motion of its nodes, cost."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.measurement import SystemFailure
from benchmarks.peers.systems import SYSTEMS
from benchmarks.peers.task import Task, step_file
from docs.studies.beyond.smooth_in_time import PERIOD, Case, flag, turning
from docs.studies.study import Cell, Outcome, Picture, Study, Table
from mesh_motion_server.session.factors import FactorCache

Floats = NDArray[np.float64]

PERIODS = 10
KINDS: dict[str, dict[str, Any]] = {
    "default": {},
    "relative": {"displacement": "relative"},
    "plain": {"displacement": "absolute", "correction": "none", "allow_invalid": True},
}
#: Other systems as the benchmark sets them up, where they are installed, and the motions that they get too.
PEERS = {
    "OpenFOAM, corrected": "openfoam-converged",
    "OpenFOAM, uncorrected": "openfoam-uncorrected",
    "Kratos laplacian": "kratos-laplacian",
    "Kratos structural_similarity": "kratos-similarity",
}
PEERED = ("Turek–Hron flag, ± 80 mm", "block ± 60°")
CASES: dict[str, Callable[[], Case]] = {
    "Turek–Hron flag, ± 80 mm": flag,
    "block ± 60°": lambda: turning("thesis_block", 60.0),
    "quads ± 60°": lambda: turning("grid of quads", 60.0),
    "tetrahedra ± 30°": lambda: turning("correction_box", 30.0),
}


@dataclass(frozen=True, eq=False)
class Played:
    """Some periods of a motion.

    Attributes
    ----------
    qualities : (steps,) list of float
        The smallest of each step's mesh.
    rest : list of float
        Largest distance of a node from its place at rest after each period, as a share of the boundary's amplitude.
    step, second : float
        Largest step of a node over the largest of a boundary node; largest second difference of a node's positions,
        mesh length unit.
    seconds : float
        CPU time of a step.
    """

    qualities: list[float]
    rest: list[float]
    step: float
    second: float
    seconds: float


def play(case: Case, choices: dict[str, Any], periods: int) -> Played:
    """Play a case, each step committed before the next."""
    model = case.mesh.model(**{"quality_metric": "relative-size-skew", **choices})
    factors, points, seconds = FactorCache(1 << 28), model.points, 0.0
    places: list[Floats] = []
    for targets in case.targets * periods:
        begin = time.process_time()
        points = model.move(points, targets, factors).points
        seconds += time.process_time() - begin
        places.append(points)
    return _measured(case, places, seconds)


def play_peer(case: Case, system: str, periods: int) -> Played:
    """Play a case by one of :data:`SYSTEMS`; SystemFailure if it stops."""
    mesh, moving = case.mesh, np.sort(np.concatenate(list(case.mesh.bodies.values())))
    cells: dict[str, NDArray[np.integer[Any]]] = {block.type.name: block.nodes.astype(np.int64) for block in mesh.cells}
    displacements = np.array(case.targets * periods) - mesh.points[moving]
    task = Task(mesh.points, cells, moving, mesh.outer, displacements)
    with tempfile.TemporaryDirectory() as folder:
        cost = SYSTEMS[system].move(task, Path(folder), 1)
        return _measured(
            case, [np.load(step_file(Path(folder), k)) for k in range(task.steps)], cost.step_cpu * task.steps
        )


def _measured(case: Case, places: Sequence[Floats], seconds: float) -> Played:
    """Evaluate the positions (n, d) after each step, and the CPU time of all steps."""
    model, each = case.mesh.model(quality_metric="relative-size-skew"), len(case.targets)
    moving = model.roles.moving
    amplitude = max(_largest(targets - model.points[moving]) for targets in case.targets)
    steps = [after - before for before, after in pairwise([model.points, *places])]
    return Played(
        [model.summary(points).metric.min for points in places],
        [_largest(place - model.points) / amplitude for place in places[each - 1 :: each]],
        max(_largest(step) / _largest(step[moving]) for step in steps),
        max(_largest(after - before) for before, after in pairwise(steps)),
        seconds / len(steps),
    )


def _largest(vectors: Floats) -> float:
    return float(np.linalg.norm(vectors, axis=1).max())


def run(quick: bool) -> Outcome:
    periods = 2 if quick else PERIODS
    rows: list[list[Cell]] = []
    drawn: dict[str, dict[str, Played]] = {}
    for name, make in CASES.items():
        if quick and name != "block ± 60°":
            continue
        case = make()
        played = {kind: play(case, choices, periods) for kind, choices in KINDS.items()}
        drawn[name] = played
        peers = _peers(case, periods) if name in PEERED and not quick else ()
        rows += [[name, kind, *_row(found, played["plain"])] for kind, found in (*played.items(), *peers)]
    columns = ("motion", "method", "first period", "last", "at rest", "step", "second difference", "cost")
    return Outcome(
        (Table(columns, rows, _TABLE, digits=3),), (Picture(lambda f: _draw(f, drawn), _PICTURE, (9.0, 3.4)),)
    )


def _row(found: Played | None, plain: Played) -> list[Cell]:
    """A row of the table, from the first period on."""
    if found is None:
        return [None] * 6
    first, last = min(found.qualities[:PERIOD]), min(found.qualities[-PERIOD:])
    return [first, last, found.rest[-1], found.step, found.second / plain.second, found.seconds / plain.seconds]


def _peers(case: Case, periods: int) -> Iterator[tuple[str, Played | None]]:
    """Results of the installed systems; None for one that stops before the end."""
    for kind, system in PEERS.items():
        if SYSTEMS[system].missing() is None:
            try:
                yield kind, play_peer(case, system, periods)
            except SystemFailure:
                yield kind, None


_TABLE = (
    f"{PERIODS} periods of {PERIOD} steps, each step committed. Smallest quality of the first and of the last period "
    "(0 or negative: cells are inside out); after the last period, with the boundary at rest, the distance of the "
    "farthest node from its place, as a share of the boundary's amplitude; largest step of a node over the largest of "
    "a boundary node; largest second difference of a node's positions, and CPU time of a step, both over those of the "
    "plain motion. OpenFOAM's displacementLaplacian and Kratos as [the benchmark](../benchmarks/README.md) sets them "
    "up; a dash: the run stopped."
)
_PICTURE = f"Smallest quality, step by step, {PERIODS} periods."


def _draw(figure: Any, drawn: dict[str, dict[str, Played]]) -> None:
    shown = list(drawn)[:2]
    for ax, name in zip(figure.subplots(1, len(shown), squeeze=False)[0], shown, strict=True):
        for kind, found in ((kind, drawn[name][kind]) for kind in KINDS):
            ax.plot(np.arange(1, len(found.qualities) + 1) / PERIOD, found.qualities, label=kind, lw=1.0)
        ax.set(title=name, xlabel="period", ylabel="smallest quality", ylim=(-0.05, 1.05))
        ax.legend(fontsize=8, loc="upper right")


def claims(outcome: Outcome) -> None:
    rows: dict[Any, Any] = {(row[0], row[1]): row[2:] for row in outcome.tables[0].rows}
    for (name, kind), (first, last, rest, step, second, _) in rows.items():
        if kind == "default":
            assert last == first, name
            assert rest <= 1e-12, name
            assert step <= 2.0, name
            assert second <= 4.0, name
            assert first >= rows[name, "plain"][0], name
    assert rows["block ± 60°", "relative"][2] > 0.01


STUDY = Study(
    "What is left of a mesh after ten periods with default settings?",
    "Open: a run, not a step",
    run,
    claims,
    (
        "mesh_motion_numerics.correction.smooth_motion.SmoothMotion",
        "mesh_motion_numerics.motion.motion.MotionModel",
    ),
)
