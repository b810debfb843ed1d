"""Run moveDynamicMesh, add times to its log lines, and return the positions node by node."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.peers.measurement import Measurement, SystemFailure, cpu_seconds, peak_memory
from benchmarks.peers.openfoam.case import Settings, write_case
from benchmarks.peers.openfoam.foam_files import read_points
from benchmarks.peers.task import Task, step_file

__all__ = ["environment", "missing", "move_mesh"]

_APPLICATION = "moveDynamicMesh"
_DEBIAN_ETC = "/usr/share/openfoam"


def missing() -> str | None:
    """Why OpenFOAM cannot run here, or None."""
    return None if shutil.which(_APPLICATION) else f"not installed: no {_APPLICATION} on the path"


def environment() -> dict[str, str]:
    """The process environment, with the variables that Debian's package does not set."""
    debian = {"FOAM_ETC": f"{_DEBIAN_ETC}/etc", "WM_PROJECT_DIR": _DEBIAN_ETC} if Path(_DEBIAN_ETC).exists() else {}
    return {**debian, **os.environ}


def move_mesh(task: Task, folder: Path, settings: Settings) -> Measurement:
    """Move the task's mesh; positions go to :func:`~.task.step_file`.

    Raises
    ------
    SystemFailure
        If moveDynamicMesh stops early.
    """
    case = folder / "case"
    mesh = write_case(task, case, settings)
    watch = _Watch()
    process = subprocess.Popen(
        [_APPLICATION, "-case", str(case)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=environment(),
    )
    with process, (folder / "log.moveDynamicMesh").open("w", encoding="utf-8") as log:
        for line in process.stdout or ():
            log.write(line)
            watch.see(line, process.pid)
    if process.returncode or len(watch.steps) != task.steps:
        raise SystemFailure(f"{_APPLICATION} stopped in step {len(watch.steps) + 1}: {watch.error or 'see its log'}")
    for step, points in enumerate(_points(case, task.steps)):
        np.save(step_file(folder, step), mesh.node_values(points))
    return Measurement(watch.setup, watch.steps, watch.cpu, watch.memory)


def _points(case: Path, steps: int) -> Iterator[np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    for step in range(steps):
        yield read_points(case / str(step + 1) / "polyMesh" / "points")


@dataclass
class _Watch:
    """Times from the lines of the log: OpenFOAM flushes each line, but its own clock resolves 10 ms at best.

    A step lasts from ``Time = …`` to the first line of the mesh check that follows the motion.
    """

    start: float = field(default_factory=time.perf_counter)
    setup: float = 0.0
    steps: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    memory: int = 0
    error: str = ""
    _step_start: float | None = None
    _step_cpu: float = 0.0

    def see(self, line: str, process: int) -> None:
        now = time.perf_counter()
        self.memory = max(self.memory, peak_memory(process))
        if line.startswith("Time = "):
            self.setup = self.setup or now - self.start
            self._step_start, self._step_cpu = now, cpu_seconds(process)
        elif self._step_start is not None and line.strip().startswith(("Point usage", "Boundary openness")):
            self.steps.append(now - self._step_start)
            self.cpu.append(cpu_seconds(process) - self._step_cpu)
            self._step_start = None
        elif "FOAM FATAL" in line or "sigFpe" in line:
            self.error = self.error or ("floating point exception" if "sigFpe" in line else line.strip())
