"""``python -m benchmarks.correction``: the cost of the correction, case by case, each in a separate process."""

from __future__ import annotations

import argparse
import os
import platform
from collections.abc import Sequence
from pathlib import Path

from benchmarks.correction.cases import CASES, standard_positions
from benchmarks.correction.cost import Cost
from benchmarks.correction.report import fill, table
from benchmarks.fresh import measured_in_fresh_process


def _arguments(words: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.correction", description="The cost of the correction.")
    parser.add_argument("--out", type=Path, default=Path("out/peers"), help="folder of the meshes and the results")
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES), metavar="CASE")
    parser.add_argument("--threads", type=int, default=min(2, os.cpu_count() or 1), help="threads of the kernels")
    parser.add_argument("--repeat", type=int, default=1, help="runs of each case; the shortest counts")
    parser.add_argument("--readme", action="store_true", help="put the table into benchmarks/README.md")
    arguments = parser.parse_args(words)
    if arguments.threads < 1 or arguments.repeat < 1:
        parser.error("--threads and --repeat take a positive number")
    return arguments


def main(words: Sequence[str] | None = None) -> None:
    """Run the cases that the command line selects."""
    arguments = _arguments(words)
    arguments.out.mkdir(parents=True, exist_ok=True)
    costs: dict[str, Cost] = {}
    machine = f"{platform.machine()}, {os.cpu_count()} cores; threads of the kernels: {arguments.threads}."
    for name in arguments.cases:
        standard_positions(CASES[name], arguments.out)
        costs[name] = Cost(
            **measured_in_fresh_process(
                "correction.cost", arguments.threads, name, str(arguments.out), str(arguments.repeat)
            )
        )
        text = table(costs, machine)
        (arguments.out / "correction.md").write_text(text, encoding="utf-8")
        print(text.splitlines()[1 + len(costs)], flush=True)
    if arguments.readme:
        fill(text)


if __name__ == "__main__":
    main()
