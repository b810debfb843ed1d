"""``make mok``: the benchmark with Kratos' mesh solver and with ours; 1 if the histories differ too much."""

from __future__ import annotations

import argparse
import json
import os
import sys
from functools import partial
from pathlib import Path

from mesh_motion_server.watch.terminal.console import progress_bar
from mok_benchmark.benchmark import END_TIME
from mok_benchmark.execution import History, RunFailed, Size, missing_kratos, prepare, run
from mok_benchmark.parameters import MESH_SOLVERS
from mok_benchmark.picture import write_picture
from mok_benchmark.verdict import ALLOWED, differences, judged, table

#: The largest displacement is at 9 s.
_PEAK_TIME = 12.0


def main(arguments: list[str] | None = None) -> int:
    """Run both, write mok.json and mok.png, print the table."""
    given = _arguments(arguments)
    missing = missing_kratos()
    if missing:
        sys.stderr.write(missing + "\n")
        return os.EX_UNAVAILABLE
    size = Size(tuple(given.wall), given.coarsest, given.end_time)
    runs: dict[str, History] = {}
    for name in MESH_SOLVERS:
        folder = given.out / name.replace(" ", "-")
        mesh = prepare(folder, size)
        try:
            with progress_bar(name) as advance:
                runs[name] = run(folder, name, size, partial(advance, words=name))
        except RunFailed as error:
            sys.stderr.write(f"{name}: {error}\n")
            return 1
    outcomes = {name: judged(history, mesh.points, mesh.triangles) for name, history in runs.items()}
    found, whole = differences(*runs.values()), given.end_time >= _PEAK_TIME
    met = bool(max(found.values()) <= ALLOWED)
    write_picture(given.out / "mok.png", runs, mesh.triangles, found, whole=whole)
    record = {
        "met": met, "differences": found, "cells": len(mesh.triangles), "nodes": len(mesh.points),
        "runs": {name: outcome.as_dict() for name, outcome in outcomes.items()},
    }  # fmt: skip
    (given.out / "mok.json").write_text(json.dumps(record, indent=1) + "\n")
    sys.stdout.write(table(outcomes, found, whole))
    sys.stdout.write(f"{given.out / 'mok.png'}, {given.out / 'mok.json'}\n")
    return 0 if met else 1


def _arguments(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="mok_benchmark", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/mok"))
    parser.add_argument("--end-time", type=float, default=END_TIME, help="s")
    parser.add_argument(
        "--wall", type=int, nargs=3, metavar=("ROWS", "COLUMNS", "ORDER"), default=(16, 1, 2),
        help="elements of the wall; their order 1 (linear) or 2",
    )  # fmt: skip
    parser.add_argument("--coarsest", type=float, default=0.06, help="edge length far from the wall, m")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
