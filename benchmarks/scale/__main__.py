"""``python -m benchmarks.scale``: set-up, step, iteration and memory against size, each in a separate process."""

from __future__ import annotations

import argparse
import os
import platform
from collections.abc import Sequence
from pathlib import Path

from benchmarks.fresh import measured_in_fresh_process
from benchmarks.peers.meshes import load_or_build
from benchmarks.scale.cases import CASES, MESHES, SHAPES
from benchmarks.scale.figures import Figures, MachineLimits, WireFigures
from benchmarks.scale.picture import write_picture
from benchmarks.scale.report import fill, tables
from benchmarks.scale.results import Results

_MESHES = [*MESHES, *SHAPES]
_PICTURE = Path(__file__).parents[2] / "docs" / "images" / "scale.png"


def _arguments(words: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scale", description="Cost and memory against size.")
    parser.add_argument("--out", type=Path, default=Path("out/scale"), help="folder of the results")
    parser.add_argument(
        "--meshes", type=Path, default=Path("out/peers"), help="folder of the meshes; missing ones are built"
    )
    parser.add_argument("--sizes", nargs="+", choices=_MESHES, default=_MESHES, metavar="MESH")
    parser.add_argument("--wire", nargs="*", choices=_MESHES, default=_MESHES, metavar="MESH")
    parser.add_argument("--threads", type=int, default=1, help="threads of the kernels")
    parser.add_argument("--repeat", type=int, default=3, help="steps of each case; the shortest counts")
    parser.add_argument("--readme", action="store_true", help="put tables and plot into benchmarks/README.md")
    arguments = parser.parse_args(words)
    if arguments.threads < 1 or arguments.repeat < 1:
        parser.error("--threads and --repeat take a positive number")
    return arguments


def main(words: Sequence[str] | None = None) -> None:
    """Run the cases that the command line selects."""
    arguments = _arguments(words)
    arguments.out.mkdir(parents=True, exist_ok=True)
    threads, folder = arguments.threads, str(arguments.meshes)
    machine = (
        f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the start; "
        f"threads of the kernels: {threads}."
    )
    results = Results(
        MachineLimits.read(measured_in_fresh_process("scale.limits", os.cpu_count() or 1)), machine, threads
    )
    for name, case in CASES.items():
        if case.mesh not in arguments.sizes:
            continue
        load_or_build(case.mesh, arguments.meshes)
        given = (name, folder, str(arguments.repeat))
        results.library[name] = Figures.read(measured_in_fresh_process("scale.library", threads, *given))
        if case.mesh in arguments.wire:
            results.wire[name] = WireFigures.read(measured_in_fresh_process("scale.wire", threads, *given))
        results.save(arguments.out / "scale.json")
        (arguments.out / "scale.md").write_text(tables(results), encoding="utf-8")
        step = results.library[name].step
        print(f"{name}: step {step.wall:.3f} s, processor {step.cpu:.3f} s", flush=True)
    write_picture(results, arguments.out / "scale.png")
    print(tables(results), flush=True)
    if arguments.readme:
        fill(tables(results))
        write_picture(results, _PICTURE)


if __name__ == "__main__":
    main()
