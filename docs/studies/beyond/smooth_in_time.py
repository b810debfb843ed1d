"""How far does a node jump between two steps of a periodic motion, and does the mesh return to its start?"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from mesh_motion_numerics.mesh.cells import CellTable
from numpy.typing import NDArray

from docs.studies.beyond.valid_wherever import Subject, subject, turned
from docs.studies.moved_bodies import ROOT
from docs.studies.study import Cell, Outcome, Picture, Study, Table
from mesh_motion_server.session.factors import FactorCache

Floats = NDArray[np.float64]

PERIOD = 32
IN_TIME = ("optimised", "smooth")


@dataclass(frozen=True, eq=False)
class Case:
    """A periodic motion: a mesh, the positions of its moving nodes after each step, and the method's other settings."""

    mesh: Subject
    targets: list[Floats]
    choices: dict[str, Any]


def flag() -> Case:
    """A period of the Turek–Hron flag, ± 80 mm at its tip."""
    folder = ROOT / "examples" / "turek_hron_flag"
    with np.load(folder / "mesh.npz") as data:
        cells = {key.removeprefix("cells_"): data[key] for key in data if key.startswith("cells_")}
        sides = [data[key] for key in data if key.startswith("patch_") and key != "patch_flag"]
        moving = np.sort(data["patch_flag"])
        outer = np.unique(np.concatenate(sides))  # the ends of the flag are on the cylinder, too
        mesh = Subject(data["points"], CellTable.from_arrays(cells), {"flag": moving}, outer)
    prescribed = np.zeros((PERIOD, *mesh.points.shape))
    with np.load(folder / "motion.npz") as motion:
        prescribed[:, motion["node_ids"]] = motion["displacement"][:PERIOD]
    prescribed[np.abs(prescribed).max(axis=(1, 2)) < 1e-12] = 0.0  # the sine's rounding at whole half periods
    return Case(mesh, list(mesh.points[moving] + prescribed[:, moving]), _choices(0.4))


def turning(name: str, amplitude: float, **choices: Any) -> Case:
    """A body that turns by ± some degrees in a period; exactly at rest after half a period and at the end."""
    mesh = subject(name)
    degrees = [amplitude * np.sin(2.0 * np.pi * step / PERIOD) for step in range(1, PERIOD + 1)]
    rest = mesh.points[np.sort(mesh.bodies[next(iter(mesh.bodies))])]
    targets = [turned(mesh, angle) if abs(angle) > 1e-9 else rest for angle in degrees]
    return Case(mesh, targets, _choices(0.5) | choices)


def _choices(radius: float) -> dict[str, Any]:
    """Of every case."""
    return {
        "support_radius": radius,
        "displacement": "absolute",
        "quality_metric": "relative-size-skew",
        "quality_threshold": 0.4,
    }


#: Name → the motion, whether the quick run has it too.
CASES: dict[str, tuple[Callable[[], Case], bool]] = {
    "Turek–Hron flag": (flag, False),
    "block ± 60°": (lambda: turning("thesis_block", 60.0), True),
    "block ± 60°, reanchored": (lambda: turning("thesis_block", 60.0, displacement="reanchored"), False),
    "block ± 10°": (lambda: turning("thesis_block", 10.0), False),
    "block ± 90°": (lambda: turning("thesis_block", 90.0), False),
    "quads ± 60°": (lambda: turning("grid of quads", 60.0), True),
    "tetrahedra ± 60°": (lambda: turning("correction_box", 60.0), False),
}


@dataclass(frozen=True, eq=False)
class Played:
    """Run a period; each step is committed before the next.

    Attributes
    ----------
    ratios : list of float
        Largest step of a node over the largest step of a boundary node, for each step.
    standard, corrected : float
        Smallest quality over the period, without and with the correction.
    rest : float
        Difference of the smallest quality after the period from that of the reference mesh.
    distance : float
        Largest distance of a node after the period from where it began, mesh length unit.
    seconds : float
        CPU time of a step.
    """

    ratios: list[float]
    standard: float
    corrected: float
    rest: float
    distance: float
    seconds: float


def play(case: Case, in_time: str) -> Played:
    """Play a case with one of the corrections."""
    model = case.mesh.model(correction=in_time, **case.choices)
    factors, points, motions, ratios = FactorCache(1 << 28), model.points, [], []
    begin = time.process_time()
    for targets in case.targets:
        motion = model.move(points, targets, factors)
        length = np.linalg.norm(motion.points - points, axis=1)
        ratios.append(float(length.max() / length[model.roles.moving].max()))
        points = motion.points
        motions.append((motion.standard.metric.min, motion.corrected.metric.min))
    seconds = (time.process_time() - begin) / len(case.targets)
    least = np.array(motions).min(axis=0)
    quality = [model.summary(x).metric.min for x in (points, model.points)]
    return Played(
        ratios,
        float(least[0]),
        float(least[1]),
        float(abs(quality[0] - quality[1])),
        float(np.linalg.norm(points - model.points, axis=1).max()),
        seconds,
    )


def run(quick: bool) -> Outcome:
    rows: list[list[Cell]] = []
    ratios: dict[str, dict[str, list[float]]] = {}
    for name, (make, both) in CASES.items():
        if quick and not both:
            continue
        case, ratios[name] = make(), {}
        for in_time in IN_TIME:
            played = play(case, in_time)
            ratios[name][in_time] = played.ratios
            rows.append(
                [name, in_time, played.standard, played.corrected, max(played.ratios), played.rest, played.distance]
            )
            rows[-1].append(played.seconds)
    columns = ("motion", "correction", "standard", "corrected", "largest ratio", "quality", "node", "CPU s a step")
    picture = Picture(lambda figure: _draw(figure, ratios), _PICTURE, (9.0, 3.4))
    return Outcome((Table(columns, rows, _TABLE, digits=3),), (picture,))


_TABLE = (
    f"A period of {PERIOD} steps from the reference mesh (displacement “absolute” if the table says nothing else; a "
    "motion below relative size-skew 0.4 is corrected), each committed. Smallest relative size-skew over the period, "
    "without and with the correction; largest step of any node over the largest step of a boundary node; and after the "
    "period, at rest again, the distances of the smallest quality and of the farthest node from the reference mesh."
)
#: Values above the expected 1.5: coarse meshes, in the middle of a large motion.
_LARGEST = {"block ± 90°": 1.8, "quads ± 60°": 2.0, "tetrahedra ± 60°": 1.9}
_PICTURE = "Largest step of any node over the largest step of a boundary node; dotted: 1.5."


def _draw(figure: Any, ratios: dict[str, dict[str, list[float]]]) -> None:
    shown = [name for name in ("Turek–Hron flag", "block ± 60°", "quads ± 60°") if name in ratios]
    for ax, name in zip(figure.subplots(1, len(shown), squeeze=False)[0], shown, strict=True):
        for in_time, style in zip(IN_TIME, ("x--", "o-"), strict=True):
            ax.semilogy(range(1, PERIOD + 1), ratios[name][in_time], style, label=in_time, lw=1.0, ms=3)
        ax.axhline(1.5, color="k", lw=0.8, ls=":")
        ax.set(title=name, xlabel="step", ylabel="node / boundary step", ylim=(0.9, 25))
        ax.set_yticks([1, 2, 5, 10, 20], ["1", "2", "5", "10", "20"], minor=False)
        ax.minorticks_off()
        ax.legend(fontsize=8, loc="upper right")


def claims(outcome: Outcome) -> None:
    rows: dict[Any, Any] = {(row[0], row[1]): row[2:7] for row in outcome.tables[0].rows}
    for (name, in_time), (standard, corrected, ratio, quality, distance) in rows.items():
        assert quality <= 1e-6, name
        assert distance <= 1e-12, name
        if in_time == "smooth":
            assert ratio <= _LARGEST.get(name, 1.5), name
            assert corrected >= standard, name
    assert rows["block ± 60°", "optimised"][2] > 4.0


STUDY = Study(
    "Do nodes move smoothly in time while the correction is active, and does the mesh return?",
    "Open: smooth in time (geometric conservation); no step of a node larger than 1.5 times the boundary's",
    run,
    claims,
    (
        "mesh_motion_numerics.correction.smooth_motion.SmoothMotion",
        "mesh_motion_numerics.motion.motion.MotionModel",
    ),
)
