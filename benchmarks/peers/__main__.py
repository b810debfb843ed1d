"""``python -m benchmarks.peers --out out/peers``: measure, then write a table, a JSON file and a plot."""

from __future__ import annotations

import argparse
import os
import platform
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path

from benchmarks.peers.comparison import CASES, Outcome, compare
from benchmarks.peers.report import write_report
from benchmarks.peers.systems import SYSTEMS

#: M4 takes Gmsh and the sparse solvers minutes; ask for it by name.
_DEFAULT_CASES = [name for name in CASES if not name.startswith("M4")]


def _arguments(words: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description="Mesh motion, system by system.")
    parser.add_argument("--out", type=Path, default=Path("out/peers"), help="folder for the results")
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=_DEFAULT_CASES, metavar="CASE")
    parser.add_argument("--systems", nargs="+", choices=list(SYSTEMS), default=list(SYSTEMS), metavar="SYSTEM")
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1, help="threads a system may use")
    parser.add_argument("--repeat", type=int, default=1, help="runs of each; the one with the shortest steps counts")
    parser.add_argument("--list", action="store_true", help="list cases and systems, and what is installed")
    arguments = parser.parse_args(words)
    if arguments.threads < 1 or arguments.repeat < 1:
        parser.error("--threads and --repeat take a positive number")
    return arguments


def _announced(outcomes: Iterator[Outcome], out: Path, machine: dict[str, object]) -> list[Outcome]:
    """Collect; the report on disk is up to date after each one."""
    found: list[Outcome] = []
    for outcome in outcomes:
        found.append(outcome)
        write_report(found, machine, out)
        result = outcome.note
        if outcome.measurement and outcome.verdict:
            result = f"{outcome.measurement.step:.3g} s a step, min size-skew {outcome.verdict.min_size_skew:.3f}"
        print(f"{outcome.case:10} {SYSTEMS[outcome.system].label:50} {result}", flush=True)
    return found


def main(words: Sequence[str] | None = None) -> None:
    """Run the comparison that the command line selects."""
    arguments = _arguments(words)
    if arguments.list:
        print("cases:  ", *CASES)
        for name, system in SYSTEMS.items():
            print(f"{name:20} {system.label:50} {system.missing() or 'installed'}")
        return
    arguments.out.mkdir(parents=True, exist_ok=True)
    machine: dict[str, object] = {
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "threads": arguments.threads,
        "runs": arguments.repeat,
        "python": platform.python_version(),
        "numpy": version("numpy"),
    }
    outcomes = compare(
        arguments.cases, arguments.systems, arguments.out, threads=arguments.threads, repeat=arguments.repeat
    )
    _announced(outcomes, arguments.out, machine)
    print(f"written: {arguments.out}/peers.md, peers.json, peers.png")


if __name__ == "__main__":
    main()
