"""Measured values of a case and of the machine, as plain values that JSON can store."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Self, TypeVar

__all__ = ["Figures", "MachineLimits", "Rates", "Seconds", "StartFigures", "WireFigures", "of_threads", "timed"]

T = TypeVar("T")

#: The shortest duration is the resolution of the clock, so that ratios exist.
_TICK = max(time.get_clock_info("process_time").resolution, 1e-9)


@dataclass(frozen=True, order=True)
class Seconds:
    """Processor time of all threads, and wall time."""

    cpu: float
    wall: float

    @classmethod
    def shortest(cls, runs: list[Seconds]) -> Seconds:
        """The shortest processor time and the shortest wall time of several runs."""
        return cls(min(run.cpu for run in runs), min(run.wall for run in runs))


def of_threads(seconds: Seconds, threads: int) -> float:
    """Processor time for one thread, since other work hardly changes it; wall time for several threads."""
    return seconds.cpu if threads == 1 else seconds.wall


def timed(task: Callable[[], T]) -> tuple[Seconds, T]:
    """Times of a task in this process, and its result."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = task()
    return Seconds(max(time.process_time() - cpu, _TICK), time.perf_counter() - wall), result


@dataclass(frozen=True)
class _Read:
    """Reads dicts that ``dataclasses.asdict`` made."""

    @classmethod
    def read(cls, values: dict[str, Any]) -> Self:
        """Read a dict whose inner dicts are :class:`Seconds`."""
        known = {field.name for field in fields(cls)}
        return cls(**{k: Seconds(**v) if isinstance(v, dict) else v for k, v in values.items() if k in known})


@dataclass(frozen=True)
class StartFigures(_Read):
    """Measurements of starting.

    Attributes
    ----------
    help : Seconds
        Time of ``mesh-motion --help``.
    ready : Seconds
        Start of a server until it is ready.
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
    """Measurements of one case in the library.

    Attributes
    ----------
    nodes, cells, boundary : int
        Boundary: nodes with a role.
    setup : Seconds
        ``MotionModel.build``.
    first : Seconds
        The session's first Move.
    step : Seconds
        A step's first Move: the mesh has changed, so that nothing is in the cache.
    iteration : Seconds
        A later Move of the same step, with the full quality report.
    brief : Seconds
        The same Move with the default report: quality of the worst cells only.
    solve, displace, predict : Seconds
        Parts of ``step``; ``predict`` computes the full quality report.
    judge_brief : Seconds
        Computing the minimum quality of the mesh only.
    kept_bytes, peak_bytes : int
        Resident memory after the steps, and its largest value, minus the memory with the mesh alone.
    resident_bytes : int
        The largest resident set, libraries and mesh included.
    minimum, near_wall : float
        Minimum size-skew after the last step, of all cells and of those with a moving node.
    inverted : int
        Cells.
    boundary_error : float
        Largest error of the interpolation at a boundary node, before the node is set to its given position; a share of
        the largest displacement.
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
    """Measurements of one case through a private server; processor time is that of client, server and workers together.

    Attributes
    ----------
    setup : Seconds
        Opening a session and sending the mesh.
    first, step, iteration : Seconds
        From the displacement to the positions of all nodes, as in :class:`Figures`.
    step_share, iteration_share : float
        Share of the wall time outside the worker's computation of the motion.
    worker_bytes : int
        Peak memory of the session's worker, minus its memory while it waits for a session.
    flight_bytes : int
        Size of the arrays that pass through the worker: the mesh as sent, a step's displacement and its answer.
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
    """Rates of compiled loops on some threads.

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
    """Limits of the machine.

    Attributes
    ----------
    bandwidth : float
        Bytes read and written a second by numpy's copy of a large array, one thread.
    pair_rate : float
        Pairs of node and centre a second in the textbook's dense sum in numpy, one thread.
    one, all : Rates
        Rates of one thread, and of all.
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
        """Read a dict that ``dataclasses.asdict`` made."""
        return cls(**{**values, "one": Rates(**values["one"]), "all": Rates(**values["all"])})

    def rates(self, threads: int) -> Rates:
        """Rates of one thread, or of all."""
        return self.one if threads == 1 else self.all

    def pass_seconds(self, figures: Figures, dimension: int) -> float:
        """Seconds to read the coordinates and connectivity (8 bytes per number) of a mesh of simplices once."""
        return 8 * (dimension * figures.nodes + (dimension + 1) * figures.cells) / self.bandwidth

    def dense_seconds(self, figures: Figures) -> float:
        """Seconds to evaluate the textbook's sum: every boundary node at every node, in numpy."""
        return figures.nodes * figures.boundary / self.pair_rate
