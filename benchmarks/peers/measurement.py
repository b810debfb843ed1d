"""The measurement of a system: seconds, memory, and the positions that it wrote."""

from __future__ import annotations

import json
import re
import statistics
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

__all__ = [
    "Measurement",
    "SystemFailure",
    "cpu_seconds",
    "high_water_marks",
    "peak_memory",
    "resident_by_process",
]


class SystemFailure(Exception):
    """A system did not complete a motion; the message is one line of the system's output."""


@dataclass(frozen=True)
class Measurement:
    """Cost of one motion.

    Attributes
    ----------
    setup_seconds : float
        From the mesh in memory or on disk to being ready for the first step.
    step_seconds : list of float
        Wall time of each step: from the boundary's displacement to positions of all nodes.
    cpu_seconds : list of float
        Processor time of each step, all threads: nearly independent of other programs on the machine.
    peak_bytes : int
        Largest resident set, libraries and mesh included.
    """

    setup_seconds: float
    step_seconds: list[float]
    cpu_seconds: list[float]
    peak_bytes: int

    @property
    def step(self) -> float:
        """Mean wall time of a step, seconds: a correction that only some steps need counts."""
        return statistics.fmean(self.step_seconds)

    @property
    def step_cpu(self) -> float:
        """Mean processor time of a step, seconds."""
        return statistics.fmean(self.cpu_seconds)

    def save(self, folder: Path) -> None:
        """Write ``folder/measurement.json``."""
        (folder / "measurement.json").write_text(json.dumps(asdict(self)), encoding="utf-8")

    @classmethod
    def load(cls, folder: Path) -> Measurement:
        """Read what :meth:`save` wrote."""
        return cls(**json.loads((folder / "measurement.json").read_text(encoding="utf-8")))


def peak_memory(process: int) -> int:
    """Sum of the largest resident sets so far of a process and its descendants, bytes; 0 if the process has ended.

    The kernel's high-water mark of each address space: unlike in ``getrusage``, a parent's memory before ``exec`` does
    not count.
    """
    return sum(high_water_marks(process).values())


def cpu_seconds(process: int) -> float:
    """Processor time so far of the living threads of a process and its descendants; 0 if the process has ended."""
    nanoseconds = 0
    for member in _family(process):
        for thread in Path(f"/proc/{member}/task").glob("*/schedstat"):
            with suppress(OSError):
                nanoseconds += int(thread.read_text(encoding="ascii").split()[0])
    return nanoseconds * 1e-9


def high_water_marks(process: int) -> dict[int, int]:
    """Largest resident set so far of a process and of each of its descendants, bytes."""
    return {member: _status(member, "VmHWM") for member in _family(process)}


def resident_by_process(process: int) -> dict[int, int]:
    """Resident set of a process and of each of its descendants, bytes."""
    return {member: _status(member, "VmRSS") for member in _family(process)}


def _status(process: int, field: str) -> int:
    """A number of /proc/PID/status, bytes."""
    try:
        status = Path(f"/proc/{process}/status").read_text(encoding="ascii")
    except OSError:
        return 0
    found = re.search(rf"{field}:\s*(\d+) kB", status)
    return int(found.group(1)) * 1024 if found else 0


def _family(process: int) -> list[int]:
    """A process and its descendants."""
    members = [process]
    for member in members:
        for thread in Path(f"/proc/{member}/task").glob("*/children"):
            with suppress(OSError):
                members += [int(child) for child in thread.read_text(encoding="ascii").split()]
    return members
