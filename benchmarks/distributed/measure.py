"""Measures steps on workers that are processes of this machine."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.distributed.cases import PartitionCase
from benchmarks.distributed.figures import Row
from benchmarks.distributed.local_cluster import local_cluster
from benchmarks.distributed.partitioned import PartitionedMotion, PartitionedStep
from benchmarks.distributed.sources import FileSource, write_partitions
from mesh_motion_server.distributed.connection import Connection
from mesh_motion_server.distributed.crew import Crew, Question
from mesh_motion_server.distributed.held import HeldPartition
from mesh_motion_server.distributed.model import DistributedModel
from mesh_motion_server.distributed.packing import pack
from mesh_motion_server.distributed.split import Split
from mesh_motion_server.numerics.interpolation.factor_source import MakeEachTime
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.motion.motion import MotionModel
from mesh_motion_server.numerics.stopwatch import Stopwatch
from mesh_motion_server.session.factors import FactorCache

__all__ = ["measure_messages", "measured", "workers_on_this_machine"]

Floats = NDArray[np.float64]

METHOD = Method(correction="none")
_PATIENCE = 120.0
_EMPTY_QUESTIONS = 60
_LARGE = 4_000_000  # numbers of the array that the bandwidth is measured with


@contextmanager
def workers_on_this_machine(count: int) -> Iterator[Connection]:
    """Worker processes of one thread each, and the way to them."""
    with local_cluster(count) as cluster:
        connection = Connection(cluster.scheduler_address, _PATIENCE)
        try:
            yield connection
        finally:
            connection.close()


def _nothing(held: HeldPartition) -> bool:
    """An empty task."""
    return held is not None


def _large(held: HeldPartition) -> Floats:
    return np.ones(_LARGE) if held is not None else np.empty(0)


def _no_arguments(_number: int, _fresh: bool) -> tuple[Any, ...]:
    return ()


def measure_messages(case: PartitionCase) -> tuple[float, float, float]:
    """Seconds of an empty question, seconds for each partition more, bytes a second from a worker."""

    def seconds(crew: Crew, task: Any, repeat: int) -> float:
        question = Question(task, "questions", "summaries", _no_arguments)
        spent = []
        for _ in range(repeat):
            begin = time.perf_counter()
            crew.ask(question)
            spent.append(time.perf_counter() - begin)
        return min(spent)  # whatever else the machine does only adds

    found = {}
    with workers_on_this_machine(1) as connection:
        for count in (1, 17):
            crew = Crew(connection, f"mesh-motion-messages-{count}", count, _partitions_of(case, count))
            crew.ask(Question(_nothing, "questions", "summaries", _no_arguments))
            found[count] = seconds(crew, _nothing, _EMPTY_QUESTIONS)
            if count == 1:
                bandwidth = 8 * _LARGE / (seconds(crew, _large, 10) - found[1])
            crew.close()
    return found[1], max(found[17] - found[1], 0.0) / 16, bandwidth


def _partitions_of(case: PartitionCase, count: int) -> Callable[[int], HeldPartition]:
    split = Split.build(case.points, case.cells, count)
    return lambda number: HeldPartition(split.partition(number))


def measured(case: PartitionCase, workers: list[int], folder: Path, repeat: int) -> Iterator[Row]:
    """Rows of one mesh: on one machine, then on each number of workers in both ways; the shortest step of each."""
    model = MotionModel.build(case.points, case.cells, case.patches, METHOD)
    expected = []
    factors: FactorCache = FactorCache(1 << 30)
    here, spent = case.points, []
    for step in range(repeat + 1):
        body = here[model.roles.moving]
        wall, cpu = time.perf_counter(), time.process_time()
        motion = model.move(here, body + case.displacement(body, step), factors)
        spent.append((time.process_time() - cpu, time.perf_counter() - wall, motion.seconds["solve"]))
        here = motion.points
        expected.append(here)
    cpu, wall, solve = min(spent[1:])
    yield _row(case, "one machine", 0, wall=wall, here=cpu, solve=solve)
    del model, factors
    for count in workers:
        with workers_on_this_machine(count) as connection:
            yield _session(case, count, connection, expected)
            source = write_partitions(folder / f"{len(case.points)}-{count}", *_mesh(case), count)
            yield _partitions(case, count, connection, expected, source)


def _mesh(case: PartitionCase) -> tuple[Any, ...]:
    return case.points, case.cells, case.boundary


def _session(case: PartitionCase, workers: int, connection: Connection, expected: list[Floats]) -> Row:
    """Displacements come back."""
    begin = time.perf_counter()
    model = DistributedModel.build(*_mesh(case)[:2], case.patches, METHOD, connection=connection, partitions=workers)
    model.summary(case.points)
    setup = time.perf_counter() - begin
    factors: FactorCache = FactorCache(1 << 30)
    here, rows, moving = case.points, [], model.model.roles.moving
    for step, goal in enumerate(expected):
        body = here[moving]
        run = _Clock(model.evaluator.crew)
        motion = model.move(here, body + case.displacement(body, step), factors)
        here = motion.points
        rows.append(run.row(case, "session", workers, motion.seconds["solve"], float(np.abs(here - goal).max()), setup))
    model.evaluator.close()
    return min(rows[1:], key=lambda row: row.here + row.longest)


def _partitions(
    case: PartitionCase, workers: int, connection: Connection, expected: list[Floats], source: FileSource
) -> Row:
    """Only summaries come back."""
    begin = time.perf_counter()
    motion = PartitionedMotion(source, case.patches, METHOD, connection)
    setup = time.perf_counter() - begin
    factors: FactorCache = FactorCache(1 << 30)
    rows = []
    for step, goal in enumerate(expected):
        body = motion.boundary[motion.roles.moving]
        targets = body + case.displacement(body, step)
        run = _Clock(motion.crew)
        moved = motion.move(targets, factors)
        rows.append(run.row(case, "partitions", workers, 0.0, 0.0, setup))
        assert np.array_equal(motion.boundary, goal[source.nodes])
    own = motion.positions()
    last = expected[-1]
    difference = max(
        float(np.abs(points - last[part.nodes[part.own]]).max())
        for points, part in ((own[n], source.make(n)().mesh) for n in range(workers))
    )
    pack_seconds, solve = _pack_seconds(moved), _solve_seconds(motion, targets)
    motion.close()
    best = min(rows[1:], key=lambda row: row.here + row.longest)
    halo = sum(len(source.make(n)().mesh.nodes) for n in range(workers)) / len(case.points) - 1.0
    return _changed(best, difference=difference, pack=pack_seconds, solve=solve, halo=halo)


def _pack_seconds(step: PartitionedStep) -> float:
    """Processor time of cutting one step's coefficients up."""
    begin = time.process_time()
    for box in step.boxes:
        pack((step.stage.interpolant, *step.stage.further), box)
    return time.process_time() - begin


def _solve_seconds(motion: PartitionedMotion, targets: Floats) -> float:
    """Processor time of the interpolation, made anew, at the boundary alone."""
    begin = time.process_time()
    motion.interpolation.trial(motion.boundary, targets, MakeEachTime(), Stopwatch())
    return time.process_time() - begin


def _changed(row: Row, **changes: Any) -> Row:
    return Row(**{name: getattr(row, name) for name in row.__dataclass_fields__} | changes)


class _Clock:
    """Seconds and bytes of a crew from now on."""

    def __init__(self, crew: Crew) -> None:
        self._crew = crew
        self._traffic = crew.traffic.copy()
        self._workers = (crew.seconds, crew.longest_seconds)
        self._begin = (time.perf_counter(), time.process_time())

    def row(self, case: PartitionCase, way: str, workers: int, solve: float, difference: float, setup: float) -> Row:
        wall, here = time.perf_counter() - self._begin[0], time.process_time() - self._begin[1]
        wire = self._crew.traffic.since(self._traffic)
        found = _row(case, way, workers, wall=wall, here=here, solve=solve)
        return _changed(
            found,
            longest=self._crew.longest_seconds - self._workers[1],
            all_workers=self._crew.seconds - self._workers[0],
            sent=dict(wire.sent),
            received=dict(wire.received),
            rounds=wire.rounds,
            setup=setup,
            difference=difference,
        )


def _row(case: PartitionCase, way: str, workers: int, *, wall: float, here: float, solve: float) -> Row:
    return Row(
        case=case.name,
        way=way,
        nodes=len(case.points),
        boundary=len(case.boundary),
        workers=workers,
        halo=0.0,
        wall=wall,
        here=here,
        longest=0.0,
        all_workers=0.0,
        solve=solve,
        pack=0.0,
        sent={},
        received={},
        rounds=0,
        setup=0.0,
        difference=0.0,
    )
