"""``python -m benchmarks``: the command line, and the run itself."""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.correction.cases import CASES as CORRECTIONS
from benchmarks.correction.cases import standard_file, standard_positions
from benchmarks.correction.cost import Cost
from benchmarks.derivatives import DerivativeCost
from benchmarks.fresh import measured_in_fresh_process
from benchmarks.peers.comparison import compare
from benchmarks.peers.meshes import load_or_build
from benchmarks.scale.figures import Figures, MachineLimits, StartFigures, WireFigures
from benchmarks.scale.results import Results
from benchmarks.scale.truth import Truth
from benchmarks.summary.evidence import Evidence
from benchmarks.summary.page import fill_pages, write_page, write_plot
from benchmarks.summary.plan import PLANS, Job

__all__ = ["main"]

#: A command is stopped after this many times its expected time, and a minute.
_PATIENCE, _GRACE = 5.0, 60.0


def _arguments(words: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="All benchmarks in one run.")
    parser.add_argument("--plan", choices=list(PLANS), default="full", help="set of measurements")
    parser.add_argument("--minutes", type=float, default=20.0, help="skip jobs that would take longer than this")
    parser.add_argument("--out", type=Path, default=Path("out/bench"), help="folder of the results")
    parser.add_argument(
        "--meshes", type=Path, default=Path("out/meshes"), help="folder of the meshes; missing ones are built"
    )
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1, help="threads that a system may use")
    parser.add_argument("--repeat", type=int, default=3, help="steps of each job; the shortest counts")
    parser.add_argument("--only", nargs="+", choices=list(_JOBS), metavar="KIND")
    parser.add_argument("--without", nargs="+", default=[], metavar="MESH", help="leave these meshes out")
    parser.add_argument("--readme", action="store_true", help="put tables and plot into the README files")
    parser.add_argument(
        "--list", action="store_true", help="list the plan's jobs and the time of each on two idle cores"
    )
    arguments = parser.parse_args(words)
    if arguments.threads < 1 or arguments.repeat < 1 or not arguments.minutes > 0:
        parser.error("--threads, --repeat and --minutes take a positive number")
    return arguments


@dataclass
class _Run:
    """One run: the settings of the command line, and the results so far."""

    evidence: Evidence
    out: Path
    meshes: Path
    threads: int
    repeat: int

    def do(self, job: Job) -> None:
        """Run a job; raises SubprocessError or OSError if it fails."""
        _JOBS[job.kind](self, job)

    def measured(self, module: str, job: Job) -> dict[str, Any]:
        """In a fresh process."""
        given = (job.name, str(self.meshes), str(self.repeat))
        limit = _PATIENCE * job.seconds + _GRACE
        return measured_in_fresh_process(module, self.threads, *given, timeout=limit)


def _library(run: _Run, job: Job) -> None:
    run.evidence.results.library[job.name] = Figures.read(run.measured("scale.library", job))


def _wire(run: _Run, job: Job) -> None:
    run.evidence.results.wire[job.name] = WireFigures.read(run.measured("scale.wire", job))


def _start(run: _Run, job: Job) -> None:
    run.evidence.results.start = StartFigures.read(run.measured("start", job))


def _truth(run: _Run, job: Job) -> None:
    run.evidence.truths[job.name] = Truth(**run.measured("scale.truth", job))


def _correction(run: _Run, job: Job) -> None:
    standard_positions(CORRECTIONS[job.name], run.meshes)
    given = (job.name, str(run.meshes), "1")
    limit = _PATIENCE * job.seconds + _GRACE
    found = measured_in_fresh_process("correction.cost", run.threads, *given, timeout=limit)
    run.evidence.costs[job.name] = Cost(**found)


def _derivative(run: _Run, job: Job) -> None:
    run.evidence.derivatives[job.name] = DerivativeCost.read(run.measured("derivatives", job))


def _peer(run: _Run, job: Job) -> None:
    run.evidence.outcomes += compare(
        [job.name], [job.system], run.out, threads=run.threads, repeat=1, meshes=run.meshes
    )


_JOBS: dict[str, Callable[[_Run, Job], None]] = {
    "library": _library,
    "wire": _wire,
    "truth": _truth,
    "correction": _correction,
    "derivative": _derivative,
    "peer": _peer,
    "start": _start,
}


def _mesh(job: Job) -> str:
    """Name of the mesh of a job."""
    return job.name.split("-")[0]


def _go_through(run: _Run, jobs: Sequence[Job], seconds: float) -> None:
    """Run one job after the other while time is left; the pages on disk are up to date after each job."""
    start = time.monotonic()
    for number, job in enumerate(jobs, start=1):
        spent = time.monotonic() - start
        if spent + job.seconds > seconds:
            run.evidence.left_out.append(f"{job.text} (no time)")
            continue
        print(f"[{spent:5.0f} s] {number} of {len(jobs)}: {job.text}", flush=True)
        try:
            run.do(job)
        except (subprocess.SubprocessError, OSError) as failure:
            run.evidence.left_out.append(f"{job.text} (failed)")
            print(f"          failed: {failure}", flush=True)
        write_page(run.evidence, run.out)


def main(words: Sequence[str] | None = None) -> None:
    """Run the jobs that the command line selects."""
    arguments = _arguments(words)
    jobs = [job for job in PLANS[arguments.plan] if not arguments.only or job.kind in arguments.only]
    jobs = [job for job in jobs if _mesh(job) not in arguments.without]
    if arguments.list:
        for job in jobs:
            print(f"{job.seconds:4.0f} s  {job.text}")
        print(f"{sum(job.seconds for job in jobs) / 60:.0f} minutes")
        return
    arguments.out.mkdir(parents=True, exist_ok=True)
    for mesh in dict.fromkeys(_mesh(job) for job in jobs):
        load_or_build(mesh, arguments.meshes)
    for job in jobs:
        if job.kind == "correction":  # the standard motion of another version
            standard_file(CORRECTIONS[job.name], arguments.meshes).unlink(missing_ok=True)
    start = time.monotonic()
    machine = (
        f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the start; "
        f"threads of the kernels: {arguments.threads}."
    )
    limits = MachineLimits.read(measured_in_fresh_process("scale.limits", os.cpu_count() or 1))
    evidence = Evidence(Results(limits, machine, arguments.threads))
    run = _Run(evidence, arguments.out, arguments.meshes, arguments.threads, arguments.repeat)
    _go_through(run, jobs, 60 * arguments.minutes - (time.monotonic() - start))
    write_page(evidence, arguments.out)
    write_plot(evidence, arguments.out)
    if arguments.readme:
        fill_pages(evidence)
    print((arguments.out / "bench.md").read_text(encoding="utf-8"), flush=True)
    print(f"{(time.monotonic() - start) / 60:.1f} minutes; written: {arguments.out}/bench.md, bench.json, scale.png")
