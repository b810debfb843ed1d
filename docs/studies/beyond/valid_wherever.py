"""Large motions in one Move: is the mesh valid after the plain motion, after a direct correction, and in legs?"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.motion.motion_found import Motion
from mesh_motion_numerics.quality.metrics import cell_quality
from mesh_motion_protocol.errors import QualityRefused
from numpy.typing import NDArray

from docs.studies.beyond.slip_and_periodic import Duct
from docs.studies.moved_bodies import ROOT, Turn
from docs.studies.study import Cell, Outcome, Picture, Study, Table

Floats = NDArray[np.float64]
Bodies = dict[str, NDArray[np.int64]]

GRIDS = {"grid of quads": (2, 10), "grid of hexahedra": (3, 10)}


@dataclass(frozen=True, eq=False)
class Subject:
    """A mesh with moving bodies by name; the rest of the boundary is fixed."""

    points: Floats
    cells: CellTable
    bodies: Bodies
    outer: NDArray[np.int64]

    def model(self, **choices: Any) -> MotionModel:
        patches = {"outer": Patch("fixed", self.outer)}
        patches |= {name: Patch("moving", nodes) for name, nodes in self.bodies.items()}
        return MotionModel.build(self.points, self.cells, patches, Method(**{"quality_metric": "size-skew", **choices}))

    def targets(self, goes: Callable[[str, Floats], Floats]) -> Floats:
        """Target positions of the moving nodes, ascending; ``goes`` gives those of each body's points (b, d)."""
        moved = self.points.copy()
        for name, nodes in self.bodies.items():
            moved[nodes] = goes(name, self.points[nodes])
        return moved[np.sort(np.concatenate(list(self.bodies.values())))]


@cache
def subject(name: str) -> Subject:
    """A mesh of tests/references, or a grid."""
    if name in GRIDS:
        duct = Duct.build(*GRIDS[name], 0.0)
        outer = np.flatnonzero(((duct.points == 0.0) | (duct.points == 1.0)).any(axis=1))
        return Subject(duct.points, duct.cells, {"body": duct.body}, outer)
    with np.load(ROOT / "tests" / "references" / f"{name}.npz") as data:
        cells = {key.removeprefix("cells_"): data[key] for key in data if key.startswith("cells_")}
        patches = {key.removeprefix("patch_"): data[key].astype(np.int64) for key in data if key.startswith("patch_")}
        outer = patches.pop("outer")
        return Subject(data["points"], CellTable.from_arrays(cells), patches, outer)


def turned(mesh: Subject, degrees: float) -> Floats:
    """The body rotated in its place (in 3D about z)."""
    return mesh.targets(lambda _, x: Turn((0.0,) * x.shape[1], degrees)(x))


def squeezed(mesh: Subject, share: float) -> Floats:
    """The body moved towards the wall at x = 0 until only a share of the gap remains."""

    def goes(_: str, x: Floats) -> Floats:
        return x - (1.0 - share) * np.array([x[:, 0].min(), *[0.0] * (x.shape[1] - 1)])

    return mesh.targets(goes)


def passed(mesh: Subject, shift: float) -> Floats:
    """The upper body moved to the right and the lower one to the left; they are side by side at 0.4."""
    return mesh.targets(lambda name, x: x + np.array([shift if name == "upper" else -shift, 0.0]))


def exchanged(mesh: Subject, share: float) -> Floats:
    """Each body moved to the position of the other one, or a share of the way."""
    return mesh.targets(lambda name, x: x + (share if name == "upper" else -share) * np.array([0.8, -0.26]))


#: Mesh, motion, its number, whether the quick run has it too.
CASES: tuple[tuple[str, str, float, bool], ...] = (
    ("thesis_block", "turned by", 90.0, False),
    ("thesis_block", "turned by", 120.0, False),
    ("thesis_block", "turned by", 150.0, False),
    ("thesis_block", "turned by", 180.0, False),
    ("thesis_block", "squeezed to", 0.5, False),
    ("thesis_block", "squeezed to", 0.25, False),
    ("thesis_block", "squeezed to", 0.1, True),
    ("correction_slab", "turned by", 180.0, False),
    ("passing_blocks", "passed by", 0.4, False),
    ("passing_blocks", "passed by", 0.5, False),
    ("passing_blocks", "passed by", 0.7, True),
    ("passing_blocks", "passed by", 1.0, False),
    ("passing_blocks", "exchanged", 1.0, False),
    ("passing_ellipses", "passed by", 0.5, False),
    ("passing_ellipses", "passed by", 0.9, False),
    ("passing_ellipses", "passed by", 1.0, False),
    ("passing_ellipses", "exchanged", 1.0, False),
    ("grid of quads", "turned by", 120.0, False),
    ("grid of quads", "turned by", 180.0, True),
    ("grid of quads", "squeezed to", 0.1, False),
    ("correction_box", "turned by", 90.0, False),
    ("correction_box", "turned by", 180.0, False),
    ("correction_box", "squeezed to", 0.1, False),
    ("grid of hexahedra", "turned by", 180.0, False),
    ("grid of hexahedra", "squeezed to", 0.1, False),
)
_MOTIONS: dict[str, Callable[[Subject, float], Floats]] = {
    "turned by": turned,
    "squeezed to": squeezed,
    "passed by": passed,
    "exchanged": exchanged,
}
PICTURED = (
    ("passing_blocks", "passed by", 0.7),
    ("grid of quads", "turned by", 180.0),
    ("thesis_block", "turned by", 180.0),
)
_WINDOWS = {"passing_blocks": (-1.1, 1.1, -0.6, 0.6), "thesis_block": (0.2, 0.8, 0.2, 0.8)}

#: Random motions: mesh → of the full study, of the quick one.
RANDOM = {
    "thesis_block": (20, 0),
    "passing_blocks": (20, 0),
    "passing_ellipses": (20, 2),
    "grid of quads": (20, 3),
    "correction_box": (5, 0),
    "grid of hexahedra": (5, 0),
}


def random_motions(name: str, count: int) -> Iterator[Floats]:
    """Turns of 90° to 180° with shifts over up to half of the gap to the walls, or bodies that pass with some room."""
    mesh, rng = subject(name), np.random.default_rng(2027)
    d = mesh.points.shape[1]
    for _ in range(count):
        if name.startswith("passing"):
            along, apart = rng.uniform(0.3, 1.1), rng.uniform(0.0, 0.1)
            sides = {"upper": np.array([along, apart]), "lower": -np.array([along, apart])}
            yield mesh.targets(lambda body, x, sides=sides: x + sides[body])  # type: ignore[misc]
        else:
            shift = tuple(rng.uniform(-0.15, 0.15, size=(d,)))
            turn = Turn(shift, float(rng.choice([-1.0, 1.0]) * rng.uniform(90.0, 180.0)))
            yield mesh.targets(lambda _, x, turn=turn: turn(x))  # type: ignore[misc]


#: Motions of which many are impossible: mesh → of the full study, of the quick one.
ANYWHERE = {
    "thesis_block": (60, 0),
    "correction_slab": (60, 0),
    "grid of quads": (60, 6),
    "correction_box": (60, 0),
    "grid of hexahedra": (60, 0),
}


def anywhere(name: str, count: int) -> Iterator[Floats]:
    """Turns of up to half a turn with shifts over up to the whole gap to the walls, and beyond it."""
    mesh, rng = subject(name), np.random.default_rng(2028)
    for _ in range(count):
        turn = Turn(tuple(rng.uniform(-0.45, 0.45, size=(mesh.points.shape[1],))), rng.uniform(-180.0, 180.0))
        yield mesh.targets(lambda _, x, turn=turn: turn(x))  # type: ignore[misc]


@dataclass(frozen=True)
class Tried:
    """Result of a method: smallest quality (for a refusal the best one found), and the motion."""

    minimum: float
    motion: Motion | None


def tried(mesh: Subject, targets: Floats, **choices: Any) -> Tried:
    """One Move from the reference mesh."""
    model = mesh.model(**choices)
    try:
        motion = model.move(model.points, targets)
    except QualityRefused as refusal:
        return Tried(min(float(refusal.best or 0.0), -1e-12), None)
    return Tried(motion.corrected.metric.min, motion)


def plain(mesh: Subject, targets: Floats) -> Tried:
    """The standard motion, valid or not."""
    return tried(mesh, targets, correction="none", allow_invalid=True)


def run(quick: bool) -> Outcome:
    chosen = [(name, motion, number) for name, motion, number, both in CASES if both or not quick]
    rows = [_row(name, motion, number) for name, motion, number in chosen]
    columns: tuple[str, ...] = ("mesh", "motion", "standard", "corrected directly", "default", "legs")
    cases = Table(columns, rows, _CASES, digits=3)
    fresh = [_random_row(name, counts[1 if quick else 0]) for name, counts in RANDOM.items() if counts[quick]]
    columns = ("mesh", "motions", "valid: standard", "corrected directly", "default", "least", "mean")
    random = Table(columns, fresh, _RANDOM, digits=3)
    chances = [_refusals(name, counts[quick]) for name, counts in ANYWHERE.items() if counts[quick]]
    times = (f"{what}: {which}" for what in ("accepted", "refused") for which in ("median", "hardest"))
    columns = ("mesh", "motions", "refused", *times, "ratio")
    refusals = Table(columns, chances, _REFUSALS, digits=3)
    return Outcome((cases, random, refusals), (Picture(_draw, _PICTURE, (9.5, 7.8)),))


_CASES = (
    "Smallest size-skew after one Move; negative: the Move is refused, and this is the best mesh that was found. The "
    "default takes several legs only if the direct motion would be refused."
)
_RANDOM = (
    "Fresh random motions: turns of 90° to 180° with shifts up to 0.15 along each axis, and bodies that pass each "
    "other with 0.1 to 0.3 between them. `least` and `mean`: smallest and mean minimum quality of the default."
)
_REFUSALS = (
    "Random motions, many of them impossible: turns of up to 180° with shifts of up to 0.45 along each axis. CPU ms "
    "of a Move, with the search for an acceptable fraction; the ratio is that of the hardest refused motion to the "
    "hardest accepted one. The fraction of each refusal was sent back and accepted."
)
_PICTURE = (
    "Left: the reference mesh; middle: the standard motion in one step, inverted cells filled; right: the default "
    "method for the same Move."
)


def _row(name: str, motion: str, number: float) -> list[Cell]:
    mesh = subject(name)
    targets = _MOTIONS[motion](mesh, number)
    direct = tried(mesh, targets, sub_steps="never")
    default = direct if direct.motion is not None else tried(mesh, targets)
    legs = default.motion.sub_steps if default.motion is not None else None
    title = _titled(motion, number)
    return [name, title, plain(mesh, targets).minimum, direct.minimum, default.minimum, legs]


def _random_row(name: str, count: int) -> list[Cell]:
    mesh, found = subject(name), []
    for targets in random_motions(name, count):
        direct = tried(mesh, targets, sub_steps="never")
        default = direct if direct.motion is not None else tried(mesh, targets)
        found.append([one.minimum for one in (plain(mesh, targets), direct, default)])
    minima = np.array(found)
    return [
        name,
        count,
        *(int(n) for n in (minima > 0.0).sum(axis=0)),
        float(minima[:, 2].min()),
        float(minima[:, 2].mean()),
    ]


def _refusals(name: str, count: int) -> list[Cell]:
    mesh = subject(name)
    model, accepted, refused = mesh.model(), [], []
    rest = model.points[model.roles.moving]
    for targets in anywhere(name, count):
        begin = time.process_time()
        try:
            model.move(model.points, targets)
            accepted.append(1e3 * (time.process_time() - begin))
        except QualityRefused as refusal:
            refused.append(1e3 * (time.process_time() - begin))
            model.move(model.points, rest + (refusal.fraction or 0.0) * (targets - rest))
    hardest = [max(times, default=np.nan) for times in (accepted, refused)]
    return [
        name, count, len(refused), float(np.median(accepted)), hardest[0], float(np.median(refused)), hardest[1],
        hardest[1] / hardest[0],
    ]  # fmt: skip


def _draw(figure: Any) -> None:
    rows = figure.subplots(len(PICTURED), 3)
    for axes, (name, motion, number) in zip(rows, PICTURED, strict=True):
        mesh = subject(name)
        targets = _MOTIONS[motion](mesh, number)
        model = mesh.model()
        tangled = plain(mesh, targets).motion
        found = model.move(model.points, targets)
        assert tangled is not None
        shown = (("reference", model.points), ("standard, one step", tangled.points), ("default", found.points))
        for ax, (title, points) in zip(axes, shown, strict=True):
            _draw_mesh(ax, model, points)
            minimum = model.summary(points).metric.min
            steps = f", {found.sub_steps} legs" if title == "default" and found.sub_steps > 1 else ""
            ax.set_title(f"{title}{steps}: {minimum:.3f}".replace("-", "−"), fontsize=9)
            ax.set(aspect="equal", xticks=[], yticks=[])
            if name in _WINDOWS:
                ax.set(xlim=_WINDOWS[name][:2], ylim=_WINDOWS[name][2:])
        axes[0].set_ylabel(f"{name.replace('_', ' ')}\n{_titled(motion, number)}", fontsize=9)


def _titled(motion: str, number: float) -> str:
    """A motion and its size."""
    if motion == "exchanged":
        return motion
    return f"{motion} {number:g}" + ("°" if motion == "turned by" else "")


def _draw_mesh(ax: Any, model: MotionModel, points: Floats) -> None:
    """The cells of a plane mesh, inverted ones filled."""
    from matplotlib.collections import PolyCollection  # noqa: PLC0415 matplotlib only where something is drawn

    nodes = model.cells.blocks[0].nodes
    inverted = cell_quality(points, model.cells, model.reference_sizes).inverted
    ax.add_collection(PolyCollection(points[nodes], facecolors="none", edgecolors="0.35", linewidths=0.3))  # type: ignore[arg-type]
    ax.add_collection(PolyCollection(points[nodes[inverted]], facecolors="tab:red", alpha=0.4))  # type: ignore[arg-type]
    ax.autoscale_view()


def claims(outcome: Outcome) -> None:
    cases, random, refusals = outcome.tables
    assert all(0 < refused < motions for _, motions, refused, *_ in refusals.rows)
    assert min(cases.column("default")) > 0.0
    for direct, default in zip(cases.column("corrected directly"), cases.column("default"), strict=True):
        assert default == direct or direct <= 0.0
    for row in random.rows:
        assert row[4] == row[1] >= row[3] >= row[2], row


STUDY = Study(
    "Is there a valid mesh after one Move, however far it is?",
    "Open: rotations of 180° in one step, squeezes to a tenth of the gap, bodies that pass each other",
    run,
    claims,
    (
        "mesh_motion_numerics.motion.sub_steps.walk",
        "mesh_motion_numerics.motion.body_paths.ways",
        "mesh_motion_numerics.correction.trial_nodes.untangle",
    ),
)
