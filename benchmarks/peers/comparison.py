"""The run itself: every case and every system, one after the other, and their outcomes as plain records."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from benchmarks.peers.judge import Judge, Verdict
from benchmarks.peers.measurement import Measurement, SystemFailure
from benchmarks.peers.meshes import MESHES, load_or_build
from benchmarks.peers.motions import MOTIONS
from benchmarks.peers.systems import SYSTEMS
from benchmarks.peers.task import Task, step_file

__all__ = ["CASES", "BenchmarkCase", "Outcome", "compare", "name_in_words"]


@dataclass(frozen=True)
class BenchmarkCase:
    """A mesh and a motion in a number of steps; written ``M1-T1-20``."""

    mesh: str
    motion: str
    steps: int

    @property
    def name(self) -> str:
        """``mesh-motion-steps``."""
        return f"{self.mesh}-{self.motion}-{self.steps}"

    def task(self, meshes: Path) -> Task:
        """Build the case's task; meshes are kept in the folder."""
        mesh = load_or_build(self.mesh, meshes)
        displacements = MOTIONS[self.motion].displacements(mesh.points[mesh.moving], self.steps)
        return Task(mesh.points, mesh.cells, mesh.moving, mesh.fixed, displacements)


CASES: dict[str, BenchmarkCase] = {
    case.name: case
    for case in (
        BenchmarkCase("M1", "T1", 1),
        BenchmarkCase("M1", "T1", 20),
        BenchmarkCase("M2", "T1", 1),
        BenchmarkCase("M2", "T1", 20),
        BenchmarkCase("M3", "T3", 1),
        BenchmarkCase("M3", "T3", 10),
        BenchmarkCase("M3", "T2s", 3),
        BenchmarkCase("M3", "T2", 20),
        BenchmarkCase("H1", "T3", 1),
        BenchmarkCase("H1", "T3", 10),
        BenchmarkCase("M4", "T3", 1),
    )
}


def name_in_words(case: str) -> str:
    """``M1: slab in a square, …; translate …, in 20 steps``."""
    chosen = CASES[case]
    steps = "one step" if chosen.steps == 1 else f"{chosen.steps} steps"
    return f"{chosen.mesh}, {MESHES[chosen.mesh][0]}: {MOTIONS[chosen.motion].text}, in {steps}"


@dataclass(frozen=True)
class Outcome:
    """Outcome of one system on one case.

    Attributes
    ----------
    measurement : Measurement or None
        The run with the shortest steps.
    note : str
        Why measurement and verdict are missing: not installed, or the system's error.
    load : float
        Load average of the machine before the run; with other load in addition to the run's threads, times are too
        long.
    """

    case: str
    system: str
    measurement: Measurement | None
    verdict: Verdict | None
    note: str
    load: float

    def as_dict(self) -> dict[str, object]:
        """As plain values."""
        return asdict(self)


def compare(
    cases: Sequence[str], systems: Sequence[str], out: Path, *, threads: int, repeat: int, meshes: Path | None = None
) -> Iterator[Outcome]:
    """Measure the systems on the cases, in a fixed order; yield each outcome as soon as it is available.

    Meshes are kept in ``out/meshes`` or in a given folder.
    """
    missing = {name: SYSTEMS[name].missing() for name in systems}
    for case_name in cases:
        task = CASES[case_name].task(meshes or out / "meshes")
        judge = Judge(task)
        for name in systems:
            load = os.getloadavg()[0]
            if reason := missing[name]:
                yield Outcome(case_name, name, None, None, reason, load)
                continue
            try:
                measurement, verdict = _best_of(repeat, name, judge, out / "runs" / case_name / name, threads)
                yield Outcome(case_name, name, measurement, verdict, "", load)
            except SystemFailure as failure:
                yield Outcome(case_name, name, None, None, f"failed: {failure}", load)


def _best_of(repeat: int, system: str, judge: Judge, folder: Path, threads: int) -> tuple[Measurement, Verdict]:
    """The run with the shortest steps, and its verdict; the positions are deleted, logs stay."""
    best = None
    for _ in range(repeat):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        measurement = SYSTEMS[system].move(judge.task, folder, threads)
        verdict = judge.verdict(np.load(step_file(folder, step)) for step in range(judge.task.steps))
        if best is None or sum(measurement.step_seconds) < sum(best[0].step_seconds):
            best = measurement, verdict
        for path in (*folder.glob("step_*.npy"), *folder.glob("task.npz")):
            path.unlink()
        shutil.rmtree(folder / "case", ignore_errors=True)
    assert best is not None
    return best
