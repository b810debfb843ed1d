"""What is measured of a case and of the machine, as plain values that go through JSON."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Self, TypeVar

__all__ = ["Figures", "MachineLimits", "Rates", "Seconds", "StartFigures", "WireFigures", "of_threads", "timed"]

T = TypeVar("T")

#: The resolution of the clock is the least duration, so that ratios exist.
_TICK = max(time.get_clock_info("process_time").resolution, 1e-9)


@dataclass(frozen=True, order=True)
class Seconds:
    """Processor time of all threads, and wall time."""

    cpu: float
    wall: float

    @classmethod
    def shortest(cls, runs: list[Seconds]) -> Seconds:
        """The shortest of each."""
        return cls(min(run.cpu for run in runs), min(run.wall for run in runs))


def of_threads(seconds: Seconds, threads: int) -> float:
    """Of one thread the processor time, which other work hardly changes; of several the wall time."""
    return seconds.cpu if threads == 1 else seconds.wall


def timed(task: Callable[[], T]) -> tuple[Seconds, T]:
    """Times of a task in this process, and its result."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = task()
    return Seconds(max(time.process_time() - cpu, _TICK), time.perf_counter() - wall), result


@dataclass(frozen=True)
class _Read:
    """Reads what ``dataclasses.asdict`` made."""

    @classmethod
    def read(cls, values: dict[str, Any]) -> Self:
        """From a dict whose dicts are :class:`Seconds`."""
        known = {field.name for field in fields(cls)}
        return cls(**{k: Seconds(**v) if isinstance(v, dict) else v for k, v in values.items() if k in known})


@dataclass(frozen=True)
class StartFigures(_Read):
    """Of starting.

    Attributes
    ----------
    help : Seconds
        Of ``mesh-motion --help``.
    ready : Seconds
        A server until it is ready.
    opened : Seconds
        ``connect()`` with a private server, and opening a mesh.
    worker_bytes : int
        Resident set of the process of a small session.
    played : Seconds
        ``mesh-motion play`` of one step, with its private server, picture and VTU files.
    """

    help: Seconds
    ready: Seconds
    opened: Seconds
    worker_bytes: int
    played: Seconds


@dataclass(frozen=True)
class Figures(_Read):
    """Of one case in the library.

    Attributes
    ----------
    nodes, cells, boundary : int
        Boundary: nodes with a role.
    setup : Seconds
        ``MotionModel.build``.
    first : Seconds
        The session's first Move.
    step : Seconds
        A step's first Move: another mesh than before, so that nothing is in the cache.
    iteration : Seconds
        A later Move of the same step, judged in full.
    brief : Seconds
        The same as it comes: judged by the worst cells alone.
    solve, displace, predict : Seconds
        Parts of ``step``; ``predict`` judges in full.
    judge_brief : Seconds
        Judging the mesh for its minimum alone.
    kept_bytes, peak_bytes : int
        Resident memory after the steps, and its largest value, less that with the mesh alone.
    resident_bytes : int
        The largest resident set, libraries and mesh included.
    minimum, near_wall : float
        Minimum size-skew after the last step, of all cells and of those with a moving node.
    inverted : int
        Cells.
    boundary_error : float
        Largest error of the interpolation at a boundary node, before it is put at its given place; a share of the
        largest displacement.
    corrected : bool
        Whether a correction followed.
    """

    nodes: int
    cells: int
    boundary: int
    setup: Seconds
    first: Seconds
    step: Seconds
    iteration: Seconds
    brief: Seconds
    solve: Seconds
    displace: Seconds
    predict: Seconds
    judge_brief: Seconds
    kept_bytes: int
    peak_bytes: int
    resident_bytes: int
    minimum: float
    near_wall: float
    inverted: int
    boundary_error: float
    corrected: bool


@dataclass(frozen=True)
class WireFigures(_Read):
    """Of one case through a private server; processor time is that of client, server and workers together.

    Attributes
    ----------
    setup : Seconds
        Opening a session and sending the mesh.
    first, step, iteration : Seconds
        From the displacement to the positions of all nodes, as in :class:`Figures`.
    step_share, iteration_share : float
        What part of the wall time the worker's motion did not take.
    worker_bytes : int
        Most memory of the session's worker beyond what it has while it waits for a session.
    flight_bytes : int
        Arrays that go through it: the mesh as sent, a step's displacement and its answer.
    """

    setup: Seconds
    first: Seconds
    step: Seconds
    iteration: Seconds
    step_share: float
    iteration_share: float
    worker_bytes: int
    flight_bytes: int


@dataclass(frozen=True)
class Rates:
    """Of compiled loops on some threads.

    Attributes
    ----------
    triad : float
        Bytes read and written a second, a = b + 3 c.
    read : float
        Bytes read a second.
    arithmetic : float
        Floating-point operations a second, fused multiply-adds on registers.
    pairs : float
        Values of Wendland's C2 function, each in a weighted sum of three components, a second.
    """

    triad: float
    read: float
    arithmetic: float
    pairs: float


@dataclass(frozen=True)
class MachineLimits:
    """What the machine can do at most.

    Attributes
    ----------
    bandwidth : float
        Bytes read and written a second by numpy's copy of a large array, one thread.
    pair_rate : float
        Pairs of node and centre a second in the textbook's dense sum in numpy, one thread.
    one, all : Rates
        Of one thread, and of all.
    threads : int
        All.
    """

    bandwidth: float
    pair_rate: float
    one: Rates
    all: Rates
    threads: int

    @classmethod
    def read(cls, values: dict[str, Any]) -> Self:
        """From what ``dataclasses.asdict`` made."""
        return cls(**{**values, "one": Rates(**values["one"]), "all": Rates(**values["all"])})

    def rates(self, threads: int) -> Rates:
        """Of one thread, or of all."""
        return self.one if threads == 1 else self.all

    def pass_seconds(self, figures: Figures, dimension: int) -> float:
        """To read the coordinates and the connectivity (8 bytes a number) of a mesh of simplices once."""
        return 8 * (dimension * figures.nodes + (dimension + 1) * figures.cells) / self.bandwidth

    def dense_seconds(self, figures: Figures) -> float:
        """To evaluate the textbook's sum: every boundary node at every node, in numpy."""
        return figures.nodes * figures.boundary / self.pair_rate
