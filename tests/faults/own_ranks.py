"""A rank that moves, judges and corrects its own nodes, on a network with faults and with a server that is killed.

The client has the mesh, the server its boundary (section 23 of the protocol). Faults occur between any two of MOVE,
JUDGE, CORRECT, the second JUDGE and COMMIT: faults of the network (:mod:`.faulty_network`) with SIGKILL of the server
among them; sometimes the client itself ends, and another one resumes with mesh and credentials. All displacements and
coordinates must be bitwise those of a session whose server has the whole mesh, and no acknowledged step may be lost.
"""

import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from mesh_motion_client import Mesh, Patch, Session, connect

from tests.faults.check import Budget, Check, Result, require
from tests.faults.faulty_network import KINDS, Fault
from tests.faults.network_driver import Work
from tests.faults.network_faults import Lane, places_of, restarter
from tests.faults.server_process import ServerProcess
from tests.faults.undisturbed import Step

#: Cells along a side; motions, which come in turn: each depends on the reference mesh alone.
_CELLS, _MOTIONS = 12, 4
_SETTINGS = {
    "displacement": "absolute",
    "correction": "optimised",
    "correction_target": "threshold",
    "quality_threshold": 0.7,
    "sub_steps": "never",
}
_STEPS = 2
_WEIGHTS = {"restart": 4.0}
_ABANDONED = 0.3  # share of the steps in which the client is gone in the middle


def square() -> Mesh:
    """Quads in a unit square; the left side moves, all others are fixed."""
    n = _CELLS + 1
    x, y = np.meshgrid(np.linspace(0.0, 1.0, n), np.linspace(0.0, 1.0, n))
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    left = points[:, 0] == 0.0
    rest = ~left & ((points == 0.0) | (points == 1.0)).any(axis=1)
    cells = {"quad": np.stack([corner, corner + 1, corner + n + 1, corner + n], axis=1)}
    patches = {"left": Patch("moving", np.flatnonzero(left)), "rest": Patch("fixed", np.flatnonzero(rest))}
    return Mesh(points, cells, patches)


def _motion(session: Session, mesh: Mesh, step: int) -> Any:
    """The side's total displacement after a step: a wave so high that cells are bad."""
    y = mesh.points[session.moving_nodes, 1]
    wave = np.sin(np.pi * y) * np.sin(2.0 * np.pi * y + step % _MOTIONS)
    return np.stack([0.25 * wave, np.zeros_like(y)], axis=1)


class WholeMesh:
    """The run of a server with the whole mesh, as :class:`.undisturbed.Undisturbed`; its digests belong to another
    state.

    ``mesh``: of the session.
    """

    def __init__(self) -> None:
        self.mesh = square()
        with connect() as server, server.open(self.mesh, _SETTINGS) as session:
            given = [_motion(session, self.mesh, step) for step in range(_MOTIONS)]
            moves = [session.move(rows) for rows in given]
        require(all(moved.correction["freed_nodes"] for moved in moves), "a motion has no cells to correct")
        found = [np.array(moved.displacement) for moved in moves]
        self._steps = [
            Step([[rows]], [[moved]], [self.mesh.points + moved], b"", [])
            for rows, moved in zip(given, found, strict=True)
        ]

    def step(self, number: int) -> Step:
        """Step 1, 2, …"""
        return self._steps[number % _MOTIONS]

    def points(self, number: int) -> list[Any]:
        """Coordinates (n, d) of the only partition after this number of steps."""
        return self.step(number).points if number else [self.mesh.points]


@contextmanager
def rank(folder: Path, whole: WholeMesh) -> Iterator[Lane]:
    """A client with an open session behind a network, and its server."""
    mesh, options = whole.mesh, {"evaluation": "client"}
    work = Work(mesh, _SETTINGS, options, "reference", mesh, lambda: whole, patience=25.0)
    with ServerProcess(folder, **places_of(range(20100, 20108))) as server:
        lane = Lane(server, None, set(), restarter(server), work)
        try:
            lane.open()
            yield lane
            lane.network.heal()
            lane.driver.close()
        finally:
            lane.network.close()


def play(lane: Lane, seed: int) -> None:
    """Run a seed: steps with faults, then one without."""
    random = Random(f"own ranks {seed}")
    kinds = [kind for kind in KINDS if kind != "half-open"]  # that one is silence, and takes a call's whole time
    chosen = random.choices(kinds, [_WEIGHTS.get(kind, 1.0) for kind in kinds], k=random.choice((1, 1, 2)))
    lane.network.arm(
        [Fault(kind, "data", random.choice(("in", "out")), random.randrange(10), random.random()) for kind in chosen]
    )
    for _ in range(_STEPS):
        if random.random() < _ABANDONED:
            lane.driver.abandon()
        lane.driver.step()
        lane.driver.check_points()
    lane.network.heal()
    lane.driver.step()
    lane.driver.check_points()


def run(seed: int, budget: Budget) -> Result:
    done = steps = 0
    struck: Counter[str] = Counter()
    with tempfile.TemporaryDirectory(prefix="mesh-motion-prove-") as folder, rank(Path(folder), WholeMesh()) as lane:
        while budget.admits(done):
            play(lane, 1_000_000 * seed + done)
            struck.update(lane.network.struck)
            done += 1
        steps = lane.driver.acknowledged
    details = {"seeds": done, "steps": steps, "faults": dict(struck), "errors": dict(lane.driver.errors)}
    got = f"{done} seeds, {struck.total()} faults, {struck['restart']} of them kills; {steps} corrected steps alike"
    return Result(got, passed=True, details=details)


CHECK = Check(
    "own-ranks",
    "{count} seeds: corrected by the ranks, bitwise as the whole mesh",
    short=8,
    full=300,
    seconds=30,
    run=run,
)
