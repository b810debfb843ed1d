"""``python -m benchmarks.distributed``: steps on worker processes of this machine, and what they predict."""

from __future__ import annotations

import argparse
import os
import platform
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks.distributed.cases import load
from benchmarks.distributed.figures import Results
from benchmarks.distributed.measure import measure_messages, measured
from benchmarks.distributed.picture import write_picture
from benchmarks.distributed.report import fill, tables

_PICTURE = Path(__file__).parents[2] / "docs" / "images" / "distributed.png"


def _arguments(words: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.distributed", description="Partitions on workers.")
    parser.add_argument("--out", type=Path, default=Path("out/distributed"), help="folder of the results")
    parser.add_argument("--meshes", type=Path, default=Path("out/peers"), help="folder of the meshes, built if need be")
    parser.add_argument("--strong", nargs="+", default=["M3", "M4"], metavar="MESH", help="the same on more workers")
    parser.add_argument("--weak", default="M3", metavar="MESH", help="one for each worker; '' for none")
    parser.add_argument("--workers", nargs="+", type=int, default=[1, 2, 4], metavar="N")
    parser.add_argument("--repeat", type=int, default=3, help="steps of each; the shortest counts")
    parser.add_argument("--again", action="store_true", help="tables and picture of the results in --out")
    parser.add_argument("--page", action="store_true", help="put tables and picture into docs/distributed.md")
    arguments = parser.parse_args(words)
    if arguments.repeat < 1 or min(arguments.workers) < 1:
        parser.error("--workers and --repeat take positive numbers")
    return arguments


def main(words: Sequence[str] | None = None) -> None:
    """Run what the command line asks for."""
    arguments = _arguments(words)
    arguments.out.mkdir(parents=True, exist_ok=True)
    stored = arguments.out / "distributed.json"
    results = Results.load(stored) if arguments.again else _run(arguments, stored)
    for text in tables(results).values():
        print(text, flush=True)
    write_picture(results, arguments.out / "distributed.png")
    if arguments.page:
        fill(results)
        write_picture(results, _PICTURE)


def _run(arguments: argparse.Namespace, stored: Path) -> Results:
    """Measure."""
    results = Results(f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the start.")
    messages = measure_messages(load((*arguments.strong, arguments.weak)[0], arguments.meshes))
    results.round_trip, results.per_task, results.bandwidth = messages
    cases = [(mesh, 1, arguments.workers) for mesh in arguments.strong]
    cases += [(arguments.weak, count, [count]) for count in arguments.workers if arguments.weak and count > 1]
    with tempfile.TemporaryDirectory(prefix="mesh-motion-partitions-") as folder:
        for mesh, copies, workers in cases:
            for row in measured(load(mesh, arguments.meshes, copies), workers, Path(folder), arguments.repeat):
                results.rows.append(row)
                results.save(stored)
                print(f"{row.case}, {row.workers} workers, {row.way}: {row.here:.3f} s here", flush=True)
    return results


if __name__ == "__main__":
    main()
