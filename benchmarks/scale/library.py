"""Measure one case in this process: ``python -m benchmarks.scale.library CASE FOLDER REPEAT`` prints JSON."""

from __future__ import annotations

import gc
import json
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from unittest.mock import patch

import numpy as np
from mesh_motion_numerics.interpolation.factor_source import MakeEachTime
from mesh_motion_numerics.interpolation.two_scale import factorization
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.motion.standard_motion import StandardTrial
from mesh_motion_numerics.quality.metrics import cell_quality
from mesh_motion_numerics.stopwatch import Stopwatch
from numpy.typing import NDArray

from benchmarks.peers.measurement import peak_memory
from benchmarks.peers.movers.small_task import small_task
from benchmarks.peers.task import Task
from benchmarks.scale.cases import CASES, Case
from benchmarks.scale.figures import Figures, Seconds, timed
from mesh_motion_server.session.factors import FactorCache

__all__ = ["FIRST_SHARE", "measured", "model_of", "near_wall"]

Floats = NDArray[np.float64]

#: The first Move of a step gets this share of its displacement, the later one all of it, as coupling iterations do.
FIRST_SHARE = 0.9

_CACHE_BYTES = 2**31


class _ProcessorStopwatch(Stopwatch):
    """Adds up the processor time of the phases as well."""

    def __init__(self) -> None:
        super().__init__()
        self.processor: dict[str, float] = {}

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        used = time.process_time()
        with super().phase(name):
            yield
        self.processor[name] = self.processor.get(name, 0.0) + time.process_time() - used

    def both(self, name: str) -> Seconds:
        """Times of a phase."""
        return Seconds(self.processor[name], self.seconds()[name])


class _Memory:
    """Growth of this process' resident memory since this object was made."""

    def __init__(self) -> None:
        gc.collect()
        with suppress(OSError):  # where the kernel allows it, reset the high-water mark
            Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
        self.base = _resident()

    def kept(self) -> int:
        """Bytes now."""
        gc.collect()
        return max(_resident() - self.base, 0)

    def peak(self) -> int:
        """Bytes at most."""
        return max(peak_memory(os.getpid()) - self.base, 0)


def _resident() -> int:
    """Bytes."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def model_of(task: Task, method: Method) -> MotionModel:
    """Of a task."""
    patches = {"moving": Patch("moving", task.moving), "fixed": Patch("fixed", task.fixed)}
    return MotionModel.build(task.points, CellTable.from_arrays(task.cells), patches, method)


def _warm_up(task: Task) -> None:
    """Import all that a motion needs, as a server does before its first session."""
    small = small_task(task)
    for most in (factorization.AUTOMATIC_FROM, 0):
        with patch.object(factorization, "AUTOMATIC_FROM", most):
            model = model_of(small, Method(quality_metric="size-skew", quality_threshold=0.0))
            for each in (model, model.without_distributions()):
                each.move(small.points, small.targets(0))


def measured(case: Case, folder: Path, repeat: int) -> Figures:
    """The figures of a case; the shortest of ``repeat`` steps counts."""
    task = case.task(folder, repeat)
    task = replace(task, cells={name: nodes.astype(np.int32) for name, nodes in task.cells.items()})  # as clients send
    _warm_up(task)
    memory = _Memory()
    setup, model = timed(lambda: model_of(task, Method(**{"quality_metric": "size-skew", **case.method})))
    committed, steps, iterations, briefs, corrected = task.points, [], [], [], False
    for step in range(repeat):
        start, targets, factors = committed, task.targets(step), FactorCache(_CACHE_BYTES)
        nearly = start[task.moving] + FIRST_SHARE * (targets - start[task.moving])
        steps.append(timed(partial(model.move, start, nearly, factors))[0])
        seconds, motion = timed(partial(model.move, start, targets, factors))
        iterations.append(seconds)
        briefs.append(timed(partial(model.without_distributions().move, start, targets, factors))[0])
        corrected = corrected or motion.points is not motion.correction.points or motion.corrected != motion.standard
        committed = motion.points if case.kind == "steady" else committed
        reached = motion.points
        del motion
    kept, peak = memory.kept(), memory.peak()
    watches, trial = _phases(model, start, targets, repeat)
    judge = model.without_distributions()
    quality = cell_quality(reached, model.cells, model.reference_sizes)
    values = quality.metric("size-skew")
    return Figures(
        nodes=len(task.points),
        cells=len(model.cells),
        boundary=len(model.roles.all),
        setup=setup,
        first=steps[0],
        step=Seconds.shortest(steps),
        iteration=Seconds.shortest(iterations),
        brief=Seconds.shortest(briefs),
        **{
            name: Seconds.shortest([watch.both(name) for watch in watches]) for name in ("solve", "displace", "predict")
        },
        judge_brief=Seconds.shortest([timed(lambda: judge.summary(trial.points))[0] for _ in range(repeat)]),
        kept_bytes=kept,
        peak_bytes=peak,
        resident_bytes=memory.base + peak,
        minimum=float(values.min()),
        near_wall=float(values[near_wall(task, model.cells)].min()),
        inverted=int(quality.inverted.sum()),
        boundary_error=_boundary_error(task, model, trial, targets),
        corrected=corrected,
    )


def _phases(
    model: MotionModel, start: Floats, targets: Floats, repeat: int
) -> tuple[list[_ProcessorStopwatch], StandardTrial]:
    """Times of the phases of a step's first Move, without the rest of the step."""
    watches = []
    for _ in range(repeat):
        watch = _ProcessorStopwatch()
        trial = model.standard_motion.trial(start, targets, MakeEachTime(), watch)
        with watch.phase("predict"):
            model.summary(trial.points)
        watches.append(watch)
    return watches, trial


def near_wall(task: Task, cells: CellTable) -> NDArray[np.bool_]:
    """(m,) bool array: True for cells with a moving node."""
    moving = np.zeros(len(task.points), dtype=bool)
    moving[task.moving] = True
    return np.concatenate([moving[block.nodes].any(axis=1) for block in cells])


def _boundary_error(task: Task, model: MotionModel, trial: StandardTrial, targets: Floats) -> float:
    """Largest error at a boundary node before the snap, as a share of the largest displacement."""
    nodes = model.roles.all
    positions = task.points.copy()
    positions[task.moving] = targets
    wanted = positions[nodes] - trial.start[nodes]
    found = np.ascontiguousarray(trial.start[nodes])
    for stage in trial.stages:
        found = stage.positions(found)
    return float(np.linalg.norm(found - positions[nodes], axis=1).max() / np.linalg.norm(wanted, axis=1).max())


def main(arguments: list[str]) -> None:
    """Run the command line that the module's docstring describes."""
    name, folder, repeat = arguments
    print(json.dumps(asdict(measured(CASES[name], Path(folder), int(repeat)))))


if __name__ == "__main__":
    main(sys.argv[1:])
