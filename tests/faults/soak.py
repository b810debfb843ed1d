"""Very many steps: memory, descriptors, threads and files of every process must not grow.

A client process moves three sessions over real sockets (:mod:`.soak_client`), in portions; after each portion the
resident memory of supervisor, gateway, each session's worker and the client is read. A leak is a slope in the second
half: that of Theil and Sen, the median of the slopes between all pairs of readings, which single jumps do not disturb.

Memory is read in pages and pools of some kilobytes, so few steps show large leaks only: a slope counts from 1 MB in 100
000 steps on, or from the smallest slope that the resolution shows in the fitted steps. Two tables have a largest number
of entries: the remembered control requests of a server and the remembered clients of a session, 1024 of each and about
1 MB. Until they are full, a slope counts from 4 MB in 100 000 steps on.
"""

import contextlib
import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import psutil  # type: ignore[import-untyped]
from scipy.stats import theilslopes

from tests.faults import soak_client
from tests.faults.check import BrokenPromise, Budget, Check, Result, require
from tests.faults.server_process import memory_folder
from tests.faults.stand_in_server import StandInServer

#: Readings of the process table in a run, and steps between two of them at least.
_READINGS, _LEAST_STEPS = 60, 25
#: Bytes a step: 1 MB in 100 000 steps.
_TARGET_SLOPE = 10.0
#: The same while tables of a bounded length are filled, and the steps after which they are full.
_FILLING_SLOPE, _FULL_AFTER = 40.0, 45_000
#: By so much the readings of a process that leaks nothing may drift over the steps that are fitted, bytes.
_RESOLUTION = 128 << 10
#: Memory with a limit in bytes must reach this limit long before the readings that count.
_SETTINGS: dict[str, Any] = {
    "stored_reply_bytes": 1 << 16,
    "factor_cache_bytes": 1 << 20,
    "history_bytes": 1 << 20,
    "idle_seconds": 60.0,
}
#: Files of the state folder may take so much more than at the first reading: a manifest's successor, a session.
_MOST_STORED = 8 << 20


@dataclass(frozen=True)
class Reading:
    steps: int
    resident_bytes: int
    files: int
    threads: int


class Soak:
    """A running server and client.

    ``readings``: by process: "supervisor", "gateway", "template", "client", and the workers of the three sessions;
    ``stored``: bytes of the state folder at each reading; ``done``: counts of the client's work, by name.
    """

    def __init__(self, folder: Path, seed: int) -> None:
        self._state, self.done = folder / "state", {"steps": 0}
        self.readings: dict[str, list[Reading]] = {}
        self.stored: list[int] = []
        self._server = StandInServer(folder, **_SETTINGS).start()
        context = get_context("spawn")
        self._line, theirs = context.Pipe()
        given = (self._server.endpoint, seed, theirs)
        self._client = context.Process(target=soak_client.main, args=given, daemon=True)
        try:
            before = self._server.workers()
            self._client.start()
            theirs.close()
            self._await_count()
            self._pids = self._name(before)
        except BaseException:
            self.close()
            raise

    def _name(self, before: set[int]) -> dict[str, int]:
        """Processes that stay: the template, which is the oldest of its kind, and the workers of the three sessions."""
        template, *workers = sorted(before | self._server.workers(), key=lambda pid: psutil.Process(pid).create_time())[
            :4
        ]
        named = {f"worker {number}": pid for number, pid in enumerate(workers, start=1)}
        return {
            "supervisor": self._server.process.pid,
            "gateway": self._server.gateway(),
            "template": template,
            "client": self._client.pid or 0,
        } | named

    def _await_count(self) -> None:
        try:
            said = self._line.recv()
        except EOFError:
            said = "without a word"
        require(isinstance(said, dict), f"the client has ended by itself, after {self.done['steps']} steps: {said}")
        self.done = said

    def go(self, steps: int) -> None:
        self._line.send(steps)
        self._await_count()
        for name, pid in self._pids.items():
            self.readings.setdefault(name, []).append(self._read(name, pid))
        self.stored.append(sum(path.stat().st_size for path in _files(self._state)))

    def _read(self, name: str, pid: int) -> Reading:
        try:
            process = psutil.Process(pid)
            memory = process.memory_info().rss
            return Reading(self.done["steps"], memory, process.num_fds(), process.num_threads())
        except psutil.NoSuchProcess:
            raise BrokenPromise(f"{name} has ended after {self.done['steps']} steps") from None

    def close(self) -> None:
        self._line.close()
        if self._client.pid is not None:
            self._client.join(30)
            self._client.kill()
        self._server.stop()


def _files(folder: Path) -> Iterator[Path]:
    for root, _, names in os.walk(folder):
        yield from (path for path in (Path(root) / name for name in names) if path.exists())


# --- judging ---


def allowed_slope(first: int, last: int) -> float:
    """The smallest growth in bytes per step that readings between these steps can show; at least the target."""
    least = _TARGET_SLOPE if first >= _FULL_AFTER else _FILLING_SLOPE
    return max(least, _RESOLUTION / max(1, last - first))


def _half(readings: Sequence[Reading]) -> Sequence[Reading]:
    return readings[len(readings) // 2 :]


def _fitted(readings: Sequence[Reading]) -> tuple[int, int]:
    return _half(readings)[0].steps, _half(readings)[-1].steps


def _slope_of(readings: Sequence[Reading]) -> float:
    """Growth in bytes per step in the second half: the median of the slopes between all pairs (Theil 1950, Sen
    1968).
    """
    half = _half(readings)
    return float(theilslopes([reading.resident_bytes for reading in half], [reading.steps for reading in half])[0])


def judge(readings: dict[str, list[Reading]], stored: Sequence[int]) -> dict[str, float]:
    """The slope of each process's memory in its second half, bytes per step.

    Raises BrokenPromise if one is too steep, or descriptors, threads or files grow.
    """
    slopes = {name: _slope_of(all_of_them) for name, all_of_them in readings.items()}
    allowed = allowed_slope(*_fitted(next(iter(readings.values()))))
    worst = max(slopes, key=lambda name: slopes[name])
    message = f"{worst} grows by {slopes[worst] / 10:.2f} MB in 100 000 steps, more than {allowed / 10:.2f}"
    require(slopes[worst] <= allowed, message)
    for name, all_of_them in readings.items():
        for what in ("files", "threads"):
            counts = [getattr(reading, what) for reading in all_of_them]
            early, late = max(counts[: len(counts) // 2]), min(counts[-len(counts) // 4 :])
            require(late <= early, f"{name} has {late} {what} or more at the end, {early} at most in its first half")
    grown = max(stored) - stored[0]
    require(grown < _MOST_STORED, f"the state folder grows by {grown} bytes")
    return slopes


# --- the row ---


@contextlib.contextmanager
def soaking(seed: int) -> Iterator[Soak]:
    with tempfile.TemporaryDirectory(prefix="mesh-motion-prove-", dir=memory_folder()) as folder:
        soak = Soak(Path(folder), seed)
        try:
            yield soak
        finally:
            soak.close()


def run(seed: int, budget: Budget) -> Result:
    with soaking(seed) as soak:
        start, portion = time.monotonic(), max(_LEAST_STEPS, budget.count // _READINGS)
        while budget.admits(soak.done["steps"]) or len(soak.stored) < 8:
            soak.go(portion)
        seconds = time.monotonic() - start
    slopes = judge(soak.readings, soak.stored)
    return _result(soak, slopes, seconds)


def _result(soak: Soak, slopes: dict[str, float], seconds: float) -> Result:
    steps = soak.done["steps"]
    allowed = allowed_slope(*_fitted(soak.readings["client"]))
    details: dict[str, Any] = {
        "done": soak.done,
        "steps_per_second": steps / seconds,
        "slopes_mb_in_100000_steps": {name: value / 10 for name, value in slopes.items()},
        "allowed_mb_in_100000_steps": allowed / 10,
        "resident_bytes": {name: readings[-1].resident_bytes for name, readings in soak.readings.items()},
        "files": {name: readings[-1].files for name, readings in soak.readings.items()},
        "threads": {name: readings[-1].threads for name, readings in soak.readings.items()},
        "stored_bytes": [soak.stored[0], max(soak.stored)],
    }
    worst = max(slopes, key=lambda name: slopes[name])
    got = (
        f"{steps} steps, {steps / seconds:.0f}/s, steepest {slopes[worst] / 10:+.2f} MB/10⁵ ({worst}), "
        f"shown from {details['allowed_mb_in_100000_steps']:.1f}"
    )
    return Result(got, True, details)


CHECK = Check(
    "soak",
    "{count} steps: no process grows by 1 MB in 10⁵ steps, nor files",
    short=12_000,  # what is bounded fills for 4000 to 5000 steps: 420 kB a worker
    full=1_000_000,
    seconds=100,
    run=run,
)
