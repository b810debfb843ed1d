"""Steps without end: memory, descriptors, threads and files of every process stay what they were.

A client process moves three sessions over the real wire (:mod:`.soak_client`), in portions; between two of them the
resident memory of supervisor, gateway, each session's worker and the client is read. A leak is a slope of the second
half: that of Theil and Sen, the median of the slopes between all pairs of readings, which single jumps do not disturb.

What a process takes up is read in pages and pools of some kilobytes, so that few steps show large leaks only: a slope
counts from 1 MB in 100 000 steps on, or from what the resolution of the readings makes of the steps that were fitted.
Two tables are bounded by a number of entries: the control requests of a server and the clients of a session that are
remembered, 1024 of each and about 1 MB. Until they are full, a slope counts from 4 MB in 100 000 steps on.
"""

import contextlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.operation.room import resident_bytes
from tests.faults.check import BrokenPromise, Budget, Check, Result, require
from tests.faults.processes import threads_of, usage_of
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
#: What is bounded by a number of bytes is to have reached it long before the readings that count.
_SETTINGS: dict[str, Any] = {
    "stored_reply_bytes": 1 << 16,
    "factor_cache_bytes": 1 << 20,
    "history_bytes": 1 << 20,
    "idle_seconds": 60.0,
}
#: Files of the state folder may take so much more than at the first reading: a manifest's successor, a session.
_MOST_STORED = 8 << 20
#: Of what a client that ends has said, characters.
_MOST_SAID = 4000


@dataclass(frozen=True)
class Reading:
    """What one process holds after so many steps."""

    steps: int
    resident_bytes: int
    files: int
    threads: int


class Soak:
    """A server and a client under way.

    ``readings``: by process: "supervisor", "gateway", "template", "client", and the workers of the three sessions;
    ``stored``: bytes of the state folder at each reading; ``done``: what the client has done, by name.
    """

    def __init__(self, folder: Path, seed: int) -> None:
        self._state, self._said = folder / "state", folder / "client.log"
        self._server = StandInServer(folder, **_SETTINGS).start()
        self.done: dict[str, int] = {}
        self.readings: dict[str, list[Reading]] = {}
        self.stored: list[int] = []
        try:
            before = self._server.workers()
            self._client = self._start(seed)
            self._pids = self._name(before)
        except BaseException:
            self._server.stop()
            raise

    def _start(self, seed: int) -> subprocess.Popen[str]:
        arguments = (self._server.endpoint, str(seed), str(os.getpid()))
        command = [sys.executable, "-m", "tests.faults.soak_client", *arguments]
        with self._said.open("w", encoding="utf-8") as log:
            client = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True, encoding="utf-8"
            )
        try:
            self._await_count(client)
        except BaseException:
            _end(client)
            raise
        return client

    def _name(self, before: set[int]) -> dict[str, int]:
        """Processes that stay: the template, which is the oldest of its kind, and those of the three sessions."""
        template, *workers = sorted(before | self._server.workers(), key=_started)[:4]
        named = {f"worker {number}": pid for number, pid in enumerate(workers, start=1)}
        return {
            "supervisor": self._server.process.pid,
            "gateway": self._server.gateway(),
            "template": template,
            "client": self._client.pid,
        } | named

    def _await_count(self, client: subprocess.Popen[str]) -> None:
        """What the client has done by now."""
        assert client.stdout is not None
        line = client.stdout.readline()
        if not line:
            after = f"after {self.done.get('steps', 0)} steps or more"
            said = self._said.read_text(encoding="utf-8", errors="replace")[-_MOST_SAID:].strip()
            raise BrokenPromise(f"the soaking client has ended by itself, {after}: {said or 'without a word'}")
        self.done = {name: int(count) for name, _, count in (word.partition("=") for word in line.split())}

    def go(self, steps: int) -> None:
        """So many steps, then a reading."""
        assert self._client.stdin is not None
        self._client.stdin.write(f"{steps}\n")
        self._client.stdin.flush()
        self._await_count(self._client)
        for name, pid in self._pids.items():
            self.readings.setdefault(name, []).append(self._read(name, pid))
        self.stored.append(sum(path.stat().st_size for path in _files(self._state)))

    def _read(self, name: str, pid: int) -> Reading:
        try:
            return Reading(self.done["steps"], resident_bytes(pid), usage_of(pid).files, threads_of(pid))
        except OSError:
            raise BrokenPromise(f"{name} has ended after {self.done['steps']} steps") from None

    def close(self) -> None:
        """End both."""
        if self._client.stdin is not None:
            self._client.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._client.wait(30)
        _end(self._client)
        self._server.stop()


def _end(client: subprocess.Popen[str]) -> None:
    """Kill it if it has not ended, and close its pipes."""
    client.kill()
    client.wait()
    for stream in (client.stdin, client.stdout):
        if stream is not None:
            stream.close()


def _started(pid: int) -> int:
    """When a process was started, in the clock's ticks."""
    return int(Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[19])


def _files(folder: Path) -> Iterator[Path]:
    for root, _, names in os.walk(folder):
        yield from (path for path in (Path(root) / name for name in names) if path.exists())


# --- judging ---


def slope(steps: Sequence[int], values: Sequence[float]) -> float:
    """The median of the slopes between all pairs (Theil 1950, Sen 1968)."""
    x, y = np.asarray(steps, dtype=float), np.asarray(values, dtype=float)
    i, j = np.triu_indices(len(x), 1)
    slopes: NDArray[np.float64] = (y[j] - y[i]) / (x[j] - x[i])
    return float(np.median(slopes))


def allowed_slope(first: int, last: int) -> float:
    """The smallest growth in bytes a step that readings between these steps can show, the target at least."""
    least = _TARGET_SLOPE if first >= _FULL_AFTER else _FILLING_SLOPE
    return max(least, _RESOLUTION / max(1, last - first))


def _half(readings: Sequence[Reading]) -> Sequence[Reading]:
    return readings[len(readings) // 2 :]


def _fitted(readings: Sequence[Reading]) -> tuple[int, int]:
    """The steps between which a slope is fitted."""
    return _half(readings)[0].steps, _half(readings)[-1].steps


def _slope_of(readings: Sequence[Reading]) -> float:
    """Bytes a step in the second half."""
    half = _half(readings)
    return slope([reading.steps for reading in half], [reading.resident_bytes for reading in half])


def judge(readings: dict[str, list[Reading]], stored: Sequence[int]) -> dict[str, float]:
    """The slope of each process's memory in its second half, bytes a step.

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
    """A soak in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="mesh-motion-prove-", dir=memory_folder()) as folder:
        soak = Soak(Path(folder), seed)
        try:
            yield soak
        finally:
            soak.close()


def run(seed: int, budget: Budget) -> Result:
    """So many steps."""
    with soaking(seed) as soak:
        start, portion = time.monotonic(), max(_LEAST_STEPS, budget.count // _READINGS)
        while budget.admits(soak.done.get("steps", 0)) or len(soak.stored) < 8:
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
