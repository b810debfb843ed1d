"""The cost of a session's history for a step: ``python -m benchmarks.history [--folder DIR] [--steps N]``.

Two sessions of the same mesh alternate, one with a history and one without. Each step is a Move and a commit through
the whole service layer, without a socket. The difference is taken step by step, so that changes of the machine's load
affect both sessions alike; medians, in microseconds. For comparison the time inside the history itself is measured, the
shortest of all steps: on a busy machine this is the only reliable figure.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_protocol.messages import Commit, Move

from mesh_motion_server.service.dispatch import SessionHost
from mesh_motion_server.service.recorder import Recorder
from mesh_motion_server.session.history import History
from mesh_motion_server.session.model import build_motion_model
from mesh_motion_server.session.partitions.meshes import PartitionMesh
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import MethodSettings, ServerSettings
from tests.faults.driver import Driver, make_spec
from tests.faults.stand_in import grid_mesh

__all__ = ["main", "measure"]

#: Nodes along a side: the smallest mesh that moves, and 50 000 nodes.
SIDES = (5, 224)
_CALLS = ((Recorder, "executed"), (History, "record_input"))
_SESSIONS = {"1" * 32: 2 << 30, "2" * 32: 0}


class _Watch:
    """The time spent in the history."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._watched = [(owner, name, getattr(owner, name)) for owner, name in _CALLS]
        for owner, name, call in self._watched:
            setattr(owner, name, self._timed(call))

    def end(self) -> None:
        """Watch no more."""
        for owner, name, call in self._watched:
            setattr(owner, name, call)

    def _timed(self, call: Any) -> Any:
        def timed(*arguments: Any, **named: Any) -> Any:
            start = time.perf_counter()
            try:
                return call(*arguments, **named)
            finally:
                self.seconds += time.perf_counter() - start

        return timed


def measure(folder: Path, side: int, steps: int) -> dict[str, float]:
    """Microseconds: a step without a history, the increase with a history, and the shortest time inside the history."""
    watch = _Watch()
    try:
        return _measure(watch, folder, side, steps)
    finally:
        watch.end()


def _measure(watch: _Watch, folder: Path, side: int, steps: int) -> dict[str, float]:
    with_history, without = (_session(folder, name, side, granted) for name, granted in _SESSIONS.items())
    plain, added, within = [], [], []
    for step in range(1, steps + 1):
        order = (with_history, without) if step % 2 else (without, with_history)
        taken = {}
        for driver in order:
            watch.seconds = 0.0
            taken[driver] = _step(driver, step)
            if driver is with_history:
                within.append(watch.seconds)
        if step > steps // 10:  # caches are warm
            plain.append(taken[without])
            added.append(taken[with_history] - taken[without])
    found = {"step": statistics.median(plain), "added": statistics.median(added), "within": min(within)}
    return {name: 1e6 * seconds for name, seconds in found.items()}


def _session(folder: Path, name: str, side: int, granted: int) -> Driver:
    mesh = _boxed(side)
    settings = MethodSettings(support_radius=0.3, correction="none", quality_threshold=0.0)
    spec = make_spec(name, durability="relaxed", settings=settings)
    limits = ServerSettings(history_bytes=granted, reserve_disk_bytes=0)
    host = SessionHost.create(spec, SessionStore(folder), limits=limits, build_model=build_motion_model)
    driver = Driver(host, [mesh])
    driver.open()
    return driver


def _boxed(side: int) -> PartitionMesh:
    """A grid whose left side moves between fixed walls."""
    mesh = grid_mesh(side)
    sides = np.flatnonzero(((mesh.points == 0) | (mesh.points == 1)).any(axis=1))
    left = mesh.patches["left"].nodes
    patches = {"left": Patch("moving", left), "walls": Patch("fixed", np.setdiff1d(sides, left))}
    return PartitionMesh(mesh.points, mesh.global_ids, mesh.cells, patches)


def _step(driver: Driver, step: int) -> float:
    """Seconds of a Move and its commit."""
    nodes, mesh = driver.moving[0], driver.meshes[0]
    size = 0.02 * np.sin(step)
    rows = np.stack([size * np.sin(np.pi * mesh.points[nodes, 1]), np.zeros(len(nodes))], axis=1)
    start = time.perf_counter()
    driver.all(Move, [rows], step=step, frame="reference")
    driver.all(Commit, step=step)
    return time.perf_counter() - start


def main(arguments: list[str]) -> int:
    """Print a line for each mesh."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.history", description=__doc__)
    parser.add_argument("--folder", type=Path, help="where sessions are stored; by default a temporary folder")
    parser.add_argument("--steps", type=int, default=200, help="steps of each session")
    options = parser.parse_args(arguments)
    for side in SIDES:
        with tempfile.TemporaryDirectory(dir=options.folder) as folder:
            found = measure(Path(folder), side, options.steps)
        sys.stdout.write(
            f"{side**2} nodes: a step {found['step']:.0f} µs, the history adds {found['added']:.0f} µs "
            f"({found['within']:.0f} µs at least)\n"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
