"""Fig 2.3: relative, absolute and re-anchored displacement on periodic motion.

A block swings about its middle, sinusoidally. *At rest* means: after whole cycles, when the boundary is at its start.
"""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import numpy as np
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.motion.motion import MotionModel
from numpy.typing import NDArray

from docs.studies.moved_bodies import StoredMesh, Turn, stored
from docs.studies.study import Outcome, Picture, Study, Table

Floats = NDArray[np.float64]

MESH = "tests/references/thesis_block"
DISPLACEMENTS = ("relative", "absolute", "reanchored")
STEPS = 16
#: Squares along a side of the mesh whose orthogonality is shown.
SQUARES = 25


class Swing:
    """A model that swings about its block's middle, with all results recorded."""

    def __init__(self, mesh: StoredMesh, displacement: str, degrees: float, steps: int) -> None:
        self.model: MotionModel = mesh.model(
            support_radius=0.5, correction="none", allow_invalid=True, displacement=displacement
        )
        self.points, self._degrees, self._steps = self.model.points, degrees, steps
        self.at_rest = [self.model.summary(self.points).metric.min]
        self.lowest: list[float] = []
        self.seconds = 0.0

    def cycle(self) -> None:
        """One cycle."""
        body, lowest, began = self.model.points[self.model.roles.moving], np.inf, time.process_time()
        for k in range(1, self._steps + 1):
            angle = self._degrees * np.sin(2.0 * np.pi * k / self._steps) if k < self._steps else 0.0
            motion = self.model.move(self.points, Turn((0.0, 0.0), angle)(body))
            self.points, lowest = motion.points, min(lowest, motion.corrected.metric.min)
        self.seconds += time.process_time() - began
        self.at_rest.append(motion.corrected.metric.min)
        self.lowest.append(lowest)

    @property
    def drift(self) -> float:
        """Largest distance of a node from its reference position."""
        return float(np.linalg.norm(self.points - self.model.points, axis=1).max())


def run(quick: bool) -> Outcome:
    """Cycles of two amplitudes and several step sizes."""
    cycles = 3 if quick else 20
    cases = [(30.0, STEPS, d) for d in DISPLACEMENTS] + [(90.0, STEPS, d) for d in DISPLACEMENTS]
    cases += [] if quick else [(30.0, 32, "relative"), (90.0, 32, "relative")]
    swings = [(case, _swung(stored(MESH), case, cycles)) for case in cases]
    rows = []
    for (degrees, steps, displacement), swing in swings:
        tangled = next((n for n, low in enumerate(swing.lowest, start=1) if low <= 0), None)
        worst = [swing.lowest[0], min(swing.lowest)]
        rest = [swing.at_rest[1], swing.at_rest[-1], swing.drift]
        milliseconds = 1000.0 * swing.seconds / (cycles * steps)
        rows.append([f"±{degrees:.0f}°", steps, displacement, *rest, *worst, tangled, milliseconds])
    columns = (
        "amplitude",
        "steps a cycle",
        "displacement",
        "at rest after 1 cycle",
        f"after {cycles}",
        "node drift",
        "worst of cycle 1",
        "worst of all",
        "tangles in cycle",
        "CPU ms a step",
    )
    table = Table(columns, rows, digits=3)
    grid = _orthogonality_table(quick)
    text = (
        f"Triangles: minimum size-skew of the thesis' block mesh (undeformed {swings[0][1].at_rest[0]:.3f}), R = "
        f"0.5, without correction."
    )
    caption = "Orthogonality of the cells at rest (1: faces normal to the line between cell centres)."
    picture = Picture(partial(draw, cycles=2 if quick else 10), caption, size=(12.0, 3.2))
    return Outcome([table, grid], [picture], text)


def _swung(mesh: StoredMesh, case: tuple[float, int, str], cycles: int) -> Swing:
    """A swing after a given number of cycles."""
    degrees, steps, displacement = case
    swing = Swing(mesh, displacement, degrees, steps)
    for _ in range(cycles):
        swing.cycle()
    return swing


def _orthogonality_table(quick: bool) -> Table:
    """Orthogonality of a mesh of squares, which is 1 everywhere at first."""
    rows = []
    for displacement in DISPLACEMENTS:
        for cycles in (1,) if quick else (1, 10):
            found = orthogonality(_swung(square_mesh(), (30.0, STEPS, displacement), cycles).points)
            rows.append([displacement, cycles, float(found.min()), float(found.mean())])
    return Table(
        ("displacement", "cycles of ±30°", "least orthogonality at rest", "mean"), rows, "A mesh of squares.", digits=4
    )


def square_mesh() -> StoredMesh:
    """Unit square of squares without its middle fifth."""
    n, low, high = SQUARES, (2 * SQUARES) // 5, SQUARES - (2 * SQUARES) // 5
    number = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    solid = np.zeros((n, n), dtype=bool)
    solid[low:high, low:high] = True
    corners = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1)[~solid]
    used, quads = np.unique(corners, return_inverse=True)
    places = np.stack(np.unravel_index(used, number.shape), axis=1)
    body = ((places >= low) & (places <= high)).all(axis=1)
    outer = ((places == 0) | (places == n)).any(axis=1)
    patches = {"block": Patch("moving", np.flatnonzero(body)), "outer": Patch("fixed", np.flatnonzero(outer))}
    return StoredMesh(places / n, CellTable.from_arrays({"quad": quads.reshape(corners.shape)}), patches)


def orthogonality(points: Floats) -> Floats:
    """(m,) smallest cosine between a face's normal and the line between the centres of its two cells, for each cell."""
    quads = square_mesh().cells.blocks[0].nodes
    edges = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(quads)), 4)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, owner = edges[order], owner[order]
    inner = np.flatnonzero((edges[:-1] == edges[1:]).all(axis=1))
    along = points[edges[inner, 1]] - points[edges[inner, 0]]
    centres = points[quads].mean(axis=1)
    across = centres[owner[inner + 1]] - centres[owner[inner]]
    sine = np.abs(along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0])
    cosine = sine / (np.linalg.norm(along, axis=1) * np.linalg.norm(across, axis=1))
    worst = np.ones(len(quads))
    for side in (inner, inner + 1):
        np.minimum.at(worst, owner[side], cosine)
    return worst


def draw(figure: Any, cycles: int) -> None:
    """The meshes at rest, coloured."""
    from matplotlib.collections import PolyCollection  # noqa: PLC0415 only where something is drawn

    mesh = square_mesh()
    cases = [("relative", 1), *((displacement, cycles) for displacement in DISPLACEMENTS)]
    axes = figure.subplots(1, len(cases))
    for axis, (displacement, count) in zip(axes, cases, strict=True):
        points = _swung(mesh, (30.0, STEPS, displacement), count).points
        corners: Any = points[mesh.cells.blocks[0].nodes]
        cells = PolyCollection(corners, array=orthogonality(points), edgecolors="0.3")
        cells.set(clim=(0.9, 1.0), linewidth=0.3, cmap="viridis")
        axis.add_collection(cells)
        axis.set(aspect="equal", xlim=(0, 1), ylim=(0, 1), xticks=[], yticks=[])
        axis.set_title(f"{displacement}, {count} cycle{'s' if count > 1 else ''}", fontsize=10)
    figure.colorbar(cells, ax=axes, shrink=0.85)


def claims(outcome: Outcome) -> None:
    """Check that relative displacement drifts and finally inverts cells, and the other two return to their start."""
    columns = outcome.tables[0].columns
    rows = [dict(zip(columns, row, strict=True)) for row in outcome.tables[0].rows]
    rest = columns[4]
    for row in rows:
        if row["displacement"] == "relative":
            assert row[rest] < row["at rest after 1 cycle"] - 0.02
            assert row["node drift"] > 1e-3
        else:
            assert row[rest] == row["at rest after 1 cycle"]
            assert row["node drift"] < 1e-14
    assert rows[3]["tangles in cycle"] is not None
    assert rows[5]["worst of all"] > 10 * rows[4]["worst of all"] > 0
    for displacement, _, least, _ in outcome.tables[1].rows:
        assert (least > 1.0 - 1e-12) == (displacement != "relative")


STUDY = Study(
    title="Does the mesh return when the body does?",
    source="Fig 2.3 (§2.1.3)",
    run=run,
    claims=claims,
    functions=("mesh_motion_numerics.motion.standard_motion.StandardMotion",),
)
