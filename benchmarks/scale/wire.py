"""Measure one case through a private server: ``python -m benchmarks.scale.wire CASE FOLDER REPEAT`` prints JSON."""

from __future__ import annotations

import json
import os
import statistics
import sys
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.measurement import cpu_seconds, high_water_marks, resident_by_process
from benchmarks.peers.movers.served import ServedMover, await_rest
from benchmarks.peers.task import Task
from benchmarks.scale.cases import CASES, Case
from benchmarks.scale.figures import Seconds, WireFigures
from benchmarks.scale.library import FIRST_SHARE

__all__ = ["measured"]

#: Steps before those that are alike: both sides make memory for the answers that they keep.
_SETTLING = 5
_LARGE_REPEAT = 1  # a rollback keeps the cache: a second large step would not be a first one


def measured(case: Case, folder: Path, repeat: int) -> WireFigures:
    """The figures of a case; the shortest of ``repeat`` steps counts, and a large motion has one step."""
    settling = _SETTLING if case.kind == "steady" else 0
    task = case.task(folder, settling + repeat if settling else _LARGE_REPEAT)
    ServedMover.prepare(task, {})
    waiting = resident_by_process(os.getpid())
    used, began = cpu_seconds(os.getpid()), time.perf_counter()
    mover = ServedMover(task, **case.method)
    setup = Seconds(cpu_seconds(os.getpid()) - used, time.perf_counter() - began)
    await_rest()  # the server prepares the next session's worker meanwhile
    steps, iterations, before = [], [], np.zeros_like(task.displacements[0])
    for displacement in task.displacements:
        increment = (displacement - before)[mover.order]
        steps.append(_move(mover, FIRST_SHARE * increment))
        iterations.append(_move(mover, increment))
        mover.session.commit()
        before = displacement
    worker = _grown(waiting, high_water_marks(os.getpid()))
    mover.session.close("discard")
    return WireFigures(
        setup,
        steps[0][0],
        Seconds.shortest([seconds for seconds, _ in steps]),
        Seconds.shortest([seconds for seconds, _ in iterations]),
        statistics.median(share for _, share in steps[settling:]),
        statistics.median(share for _, share in iterations[settling:]),
        worker,
        _in_flight(task),
    )


def _grown(before: dict[int, int], most: dict[int, int]) -> int:
    """Bytes of the session's process, minus those of the process it was forked from, the largest one before."""
    template = max(size for process, size in before.items() if process != os.getpid())
    return max(size for process, size in most.items() if process not in before) - template


def _in_flight(task: Task) -> int:
    """Bytes of the arrays of a session: mesh, roles, one displacement, one answer."""
    mesh: int = task.points.nbytes + sum(nodes.nbytes for nodes in task.cells.values())
    return int(mesh + task.moving.nbytes + task.fixed.nbytes + task.displacements[0].nbytes + task.points.nbytes)


def _move(mover: ServedMover, displacement: NDArray[np.float64]) -> tuple[Seconds, float]:
    """Times of one Move, and the share of the wall time outside the computation of its motion."""
    used, began = cpu_seconds(os.getpid()), time.perf_counter()
    moved = mover.session.move(displacement, frame="committed")
    wall = time.perf_counter() - began
    return Seconds(cpu_seconds(os.getpid()) - used, wall), 1 - moved.seconds["total"] / wall


def main(arguments: list[str]) -> None:
    """Run the command line that the module's docstring describes."""
    name, folder, repeat = arguments
    print(json.dumps(asdict(measured(CASES[name], Path(folder), int(repeat)))))


if __name__ == "__main__":
    main(sys.argv[1:])
