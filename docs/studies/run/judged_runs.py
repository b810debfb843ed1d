"""Runs of many steps with default settings, compared with bounds that matter to a flow solver: :data:`BOUNDS`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_client import Credentials, Mesh, connect
from mesh_motion_client import Patch as ClientPatch
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.finite_volume import face_measures
from mesh_motion_numerics.mesh.roles import Patch
from numpy.typing import NDArray

from docs.studies.aerofoil_grids import Grid, c_grid, o_grid
from docs.studies.beyond._layers import LayerMesh, bent_flag, bent_wing, stored_layer
from docs.studies.beyond.slip_and_periodic import BEND, Duct
from docs.studies.moved_bodies import StoredMesh, Turn, stored
from docs.studies.study import Cell, Outcome, Picture, Study, Table
from mesh_motion_server.files.mesh_file import MeshFile
from mesh_motion_server.files.partitions import partitions
from mesh_motion_server.session.factors import FactorCache

Floats = NDArray[np.float64]
Goes = Callable[[Floats, float], Floats]

#: The limits of a run, by the table's columns: at least, at most.
BOUNDS = {
    "rest": (0.0, 1e-12),
    "repeat": (0.0, 1e-12),
    "speed": (0.0, 2.0),
    "jolt at 32": (0.0, 2.0),
    "at 128": (0.0, 3.0),
    "at 256": (0.0, 3.0),
    "8 steps": (0.0, 1e-9),
    "shape / plain": (0.98, np.inf),
    "angle / plain": (0.0, 1.02),
    "noise": (0.0, 10.0),
    "resumed": (0.0, 0.0),
}
#: Interpolation alone: a layer that is kept where it does no harm is not a smooth function of the boundary.
PLAIN = {"displacement": "absolute", "correction": "none", "allow_invalid": True}
DEFAULT: dict[str, Any] = {"quality_metric": "relative-size-skew"}  # a stored mesh names another metric
_NOISE, _RANKS = 1e-8, 2


@dataclass(frozen=True, eq=False)
class Run:
    """A mesh, and ``goes``: positions of its moving nodes (k, d) at a phase from −1 to 1; and the part to play.

    ``share`` is the part of a period played in 128 and 256 steps; with ``ranks`` two ranks of a solver move the mesh.
    """

    mesh: StoredMesh
    goes: Goes
    periods: int = 2
    share: float = 1.0
    ranks: bool = False


def _turning(degrees: float) -> Goes:
    return lambda x, s: Turn((0.0,) * x.shape[1], degrees * s)(x)


def _pitching(x: Floats, s: float) -> Floats:
    """Turn by ± 15° about the quarter chord, and shift by a tenth of a chord."""
    return Turn((0.0, 0.1 * s), 15.0 * s, (0.25, 0.0))(x)


def _aerofoil(grid: Grid) -> Run:
    return Run(StoredMesh(grid.points, CellTable.from_arrays(grid.cells), grid.patches), _pitching, share=0.25)


def _prisms(layer: LayerMesh) -> Run:
    mesh = StoredMesh(layer.points, layer.cells, layer.patches)
    return Run(mesh, lambda x, s: bent_wing(x, 0.5 * s), share=0.25)


def _in_duct(bend: float, walls: str = "slip", n: int = 15) -> Run:
    """A block in a duct of n boxes along each axis, whose walls have a role."""
    duct = Duct.build(2, n, bend)
    sides = {f"{'xy'[a]}{end}": Patch(("fixed", walls)[a], duct.on(a, end)) for a in (0, 1) for end in (0, 1)}
    mesh = StoredMesh(duct.points, duct.cells, {"body": Patch("moving", duct.body), **sides})
    return Run(mesh, lambda x, s: x + s * np.array([0.1, 0.2]))


def _flag(**choices: Any) -> Run:
    return Run(stored("examples/turek_hron_flag/mesh"), bent_flag, **choices)


RUNS: dict[str, Callable[[], Run]] = {
    "flag, ± 80 mm": lambda: _flag(periods=60),
    "slab, ± 40°": lambda: Run(stored("tests/references/thesis_slab"), _turning(40.0), 60),
    "wing, ± 0.4 span and ± 30°": lambda: Run(stored("examples/tapered_wing/mesh"), bent_wing, share=0.25),
    "O-grid, ± 15°": lambda: _aerofoil(o_grid("sharp")),
    "C-grid, ± 15°": lambda: _aerofoil(c_grid("cusped", far=50.0)),
    "wing in prisms, half of it": lambda: _prisms(stored_layer("layer_wing")),
    "hexahedra, ± 40°": lambda: Run(stored("examples/hexahedral_box/mesh"), _turning(40.0), share=0.25),
    "plane slip walls": lambda: _in_duct(0.0),
    "curved slip walls": lambda: _in_duct(BEND),
    "periodic sides": lambda: _in_duct(0.0, "periodic", 60),
    "flag on two ranks": lambda: _flag(share=0.25, ranks=True),
}
QUICK = "plane slip walls"


def phases(steps: int, share: float = 1.0) -> list[float]:
    """Phases of the steps of a share of a period; exactly 0 at rest."""
    found = np.sin(2.0 * np.pi * np.arange(1, round(steps * share) + 1) / steps)
    return list(np.where(np.abs(found) < 1e-12, 0.0, found))


@dataclass(frozen=True, eq=False)
class Walk:
    """A run in steps: its moving nodes (k,), positions (n, d) at rest and after each step, CPU seconds of a step."""

    body: NDArray[np.int64]
    places: list[Floats]
    seconds: float

    @property
    def speed(self) -> float:
        """Largest step of a node over the largest step of a boundary node."""
        steps = (after - before for before, after in pairwise(self.places))
        return max(_largest(step) / _largest(step[self.body]) for step in steps)

    @property
    def jolts(self) -> list[float]:
        """Largest second difference of a node, for each pair of steps, mesh length unit."""
        steps = (after - before for before, after in pairwise(self.places))
        return [_largest(after - before) for before, after in pairwise(steps)]


def walk(run: Run, steps: list[float], choices: dict[str, Any], **last: Any) -> Walk:
    """Play a run, each step committed before the next; ``last`` changes the last step (:func:`_here`)."""
    rest = run.mesh.points
    body = np.unique(np.concatenate([p.nodes for p in run.mesh.patches.values() if p.role == "moving"]))
    targets = [run.goes(rest[body], s) for s in steps]
    begin = time.process_time()
    if run.ranks and choices is DEFAULT:
        targets[-1] = targets[-1] + last.get("noise", 0.0)
        places = _on_ranks(run.mesh, body, targets)
    else:
        places = list(_here(run.mesh, targets, choices, **last))
    return Walk(body, [rest, *places], (time.process_time() - begin) / len(steps))


def _here(
    mesh: StoredMesh,
    targets: list[Floats],
    choices: dict[str, Any],
    noise: Floats | float = 0.0,
    own_model: bool = False,
) -> Iterator[Floats]:
    """Positions after each step; ``noise`` is added to the last step's targets, ``own_model`` gives it a new model."""
    model, factors, points = mesh.model(**choices), FactorCache(1 << 28), mesh.points
    if choices is PLAIN:
        model = replace(model, layered=None)
    for step, there in enumerate(targets, start=1):
        last = step == len(targets)
        if last and own_model:
            model, factors = mesh.model(**choices), FactorCache(1 << 28)
        points = model.move(points, there + noise if last else there, factors).points
        yield points


def _on_ranks(mesh: StoredMesh, body: NDArray[np.int64], targets: list[Floats]) -> list[Floats]:
    """Positions after each step: two clients with half of the mesh each, and a server with the boundary."""
    cells = {block.type.name: block.nodes.astype(np.int64) for block in mesh.cells}
    file = MeshFile(mesh.points, cells, {name: patch.nodes for name, patch in mesh.patches.items()}, Path("whole"))
    parts, places, shared = list(partitions(file, _RANKS)), [mesh.points.copy() for _ in targets], Future[Credentials]()

    def drive(rank: int, endpoint: str) -> None:
        part, ids = parts[rank], np.asarray(parts[rank].global_ids)
        patches = {name: ClientPatch(mesh.patches[name].role, nodes) for name, nodes in part.patches.items()}
        own = Mesh(part.points, part.cells, patches, ids)
        with connect(endpoint) as server:
            if rank:
                session = server.join(shared.result(60.0), own, partition=rank)
            else:
                session = server.open(own, evaluation="client", partitions=_RANKS, announce=shared.set_result)
            with session:
                moving = ids[session.moving_nodes]
                for there, found in zip(targets, places, strict=True):
                    session.move(there[np.searchsorted(body, moving)] - mesh.points[moving])
                    session.commit()
                    found[ids] = session.points()

    with connect() as server, ThreadPoolExecutor(_RANKS) as pool:
        list(pool.map(drive, range(_RANKS), [server.endpoint] * _RANKS))
    return places


def judged(run: Run) -> tuple[dict[str, float], dict[str, tuple[int, list[float]]]]:
    """The columns of a run, and lines to draw: steps of a period, and the jolt of each step."""
    rest, cells = run.mesh.points, run.mesh.cells
    found, plain, coarse = (
        walk(run, phases(n) * k, c) for n, k, c in ((32, run.periods, DEFAULT), (32, 1, PLAIN), (8, 1, DEFAULT))
    )
    walks = {32: (replace(found, places=found.places[:33]), plain)}
    for n in (128, 256):
        walks[n] = walk(run, phases(n, run.share), DEFAULT), walk(run, phases(n, run.share), PLAIN)
    amplitude = max(_largest((place - rest)[found.body]) for place in plain.places)
    noise = _NOISE * amplitude * np.random.default_rng(1).uniform(-1.0, 1.0, (len(found.body), rest.shape[1]))

    def moved(end: Walk, choices: dict[str, Any], **last: Any) -> float:
        """Distance between the changed and the original end of the step to the peak, mesh length unit."""
        return _largest(walk(run, phases(32)[:8], choices, **last).places[-1] - end.places[8])

    ours, theirs = found.places[4:33:4], plain.places[4:33:4]
    shape, plain_shape = (min(least_shape(rest, p, cells) for p in places) for places in (ours, theirs))
    angle, plain_angle = (max(_angle(p, cells) for p in places) for places in (ours, theirs))
    columns = {
        "rest": max(_largest(place - rest) for place in found.places[16::16]) / amplitude,
        "repeat": max(_largest(p - found.places[k % 32 or 32]) for k, p in enumerate(found.places) if k) / amplitude,
        "speed": max(own.speed for own, _ in walks.values()),
        "plain speed": max(other.speed for _, other in walks.values()),
        **{
            name: max(own.jolts) / max(other.jolts)
            for name, (own, other) in zip(("jolt at 32", "at 128", "at 256"), walks.values(), strict=True)
        },
        "8 steps": max(_largest(p - q) for p, q in zip(coarse.places[1:], ours, strict=True)) / amplitude,
        "shape": shape,
        "shape / plain": shape / plain_shape if plain_shape else np.inf,
        "angle": angle,
        "angle / plain": angle / plain_angle,
        "noise": moved(found, DEFAULT, noise=noise) / _largest(noise),
        "plain noise": moved(plain, PLAIN, noise=noise) / _largest(noise),
        "resumed": np.nan if run.ranks else moved(found, DEFAULT, own_model=True),
        "cost": found.seconds / plain.seconds,
    }
    lines = {f"{n} steps": (n, own.jolts) for n, (own, _) in walks.items()}
    return columns, lines | {"plain, 256 steps": (256, walks[256][1].jolts)}


def least_shape(rest: Floats, points: Floats, cells: CellTable) -> float:
    """Smallest d det(T)^(2/d) / |T|² of T = A_now A_rest⁻¹, from the edges at any corner; 0 for an inverted one."""
    least, d = 1.0, rest.shape[1]
    for block in cells:
        corners = block.nodes[:, block.type.corner_array]
        before, now = (np.swapaxes(x[corners][:, :, 1:] - x[corners][:, :, :1], 2, 3) for x in (rest, points))
        T = now @ np.linalg.inv(before)
        shape = d * np.linalg.det(T).clip(0.0) ** (2.0 / d) / (T * T).sum(axis=(2, 3))
        least = min(least, float(shape.min()))
    return least


def _angle(points: Floats, cells: CellTable) -> float:
    """Largest non-orthogonality of a face, degrees."""
    found = face_measures(points, cells)
    return 0.0 if found is None else found.max_non_orthogonality


def _largest(vectors: Floats) -> float:
    return float(np.linalg.norm(vectors, axis=1).max())


def failures(columns: Mapping[str, float]) -> list[str]:
    """The columns outside their bounds; a column that was not measured is not included."""
    return [name for name, (low, high) in BOUNDS.items() if columns[name] < low or columns[name] > high]


def run(quick: bool) -> Outcome:
    rows: list[list[Cell]] = []
    drawn: dict[str, dict[str, tuple[int, list[float]]]] = {}
    for name in (QUICK,) if quick else RUNS:
        chosen = RUNS[name]()
        columns, drawn[name] = judged(replace(chosen, share=0.25) if quick else chosen)
        shown = [None if np.isnan(value) else value for value in columns.values()]
        rows.append([name, len(chosen.mesh.points), *shown, ", ".join(failures(columns)) or "–"])
    table = Table(("run", "nodes", *columns, "outside"), rows, _TABLE, digits=3)
    return Outcome((table,), (Picture(lambda f: _draw(f, drawn), _PICTURE, (9.0, 3.2)),))


_TABLE = (
    "Periods of 32 steps with default settings: 60 for the first two runs, 2 for the others. `rest`: distance of the "
    "farthest node from its place when the boundary is at rest; `repeat`: its distance from its place in the first "
    "period; `8 steps`: from its place after a period of 8 steps; each as a share of the boundary's amplitude. "
    "`speed`: largest step of a node over the largest of a boundary node. `jolt`: largest second difference of a "
    "node's positions, in 32, 128 and 256 steps a period, over that of the plain motion (in 128 and 256 steps a "
    "quarter of a period for aerofoils, 3D and ranks). `shape`: smallest d det(T)^(2/d) / |T|² of T = A Aᵣ⁻¹, from the "
    "edges at a corner at rest to those now. `angle`: largest non-orthogonality, degrees. `noise`: shift of the "
    "farthest node by a noise of 1e-8 of the amplitude at each boundary node, divided by that noise. `resumed`: "
    "distance of a step of a new model from the same step of the old one. `cost`: CPU time of a step over that of the "
    "plain motion. Plain is interpolation alone. Bounds: "
    + ", ".join(f"{name} {'≥' if low else '≤'} {low or high:g}" for name, (low, high) in BOUNDS.items())
    + "; the last column names the values outside their bounds."
)
_PICTURE = "Largest second difference of a node by the time of the step, times the square of the steps of a period."


def _draw(figure: Any, drawn: dict[str, dict[str, tuple[int, list[float]]]]) -> None:
    wanted: list[str] = ["flag, ± 80 mm", "slab, ± 40°", "hexahedra, ± 40°"]
    shown = [name for name in wanted if name in drawn] or list(drawn)
    for ax, name in zip(figure.subplots(1, len(shown), squeeze=False)[0], shown, strict=True):
        for label, (steps, jolts) in drawn[name].items():
            ax.plot(np.arange(1, len(jolts) + 1) / steps, np.array(jolts) * steps**2, label=label, lw=1.0)
        ax.set(title=name, xlabel="period", xlim=(0.0, 0.25))
        ax.set_ylim(bottom=0.0)
        ax.legend(fontsize=7)


#: Values that are outside of these limits today, and may not grow.
_OUTSIDE = {"C-grid, ± 15°": {"angle / plain", "noise"}}


def claims(outcome: Outcome) -> None:
    for row in outcome.tables[0].rows:
        assert set(str(row[-1]).split(", ")) - {"–"} <= _OUTSIDE.get(str(row[0]), set()), row


STUDY = Study(
    "Does a run of many steps come back, repeat and move smoothly with default settings?",
    "Open: a run, not a step",
    run,
    claims,
    ("mesh_motion_numerics.motion.motion.MotionModel",),
)
