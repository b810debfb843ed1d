"""Measure one mover in this process: ``python -m benchmarks.peers.worker MODULE:CLASS OPTIONS TASK.npz FOLDER``.

Needs numpy and the mover's own modules only. OPTIONS is a JSON object of the mover's keyword arguments.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers.measurement import Measurement, cpu_seconds, peak_memory
from benchmarks.peers.movers.mover import Mover
from benchmarks.peers.task import Task, step_file

__all__ = ["measure"]


def measure(kind: type[Mover], options: dict[str, Any], task: Task, folder: Path) -> Measurement:
    """Build the mover, run every step, write the positions to ``folder``."""
    if prepare := getattr(kind, "prepare", None):  # compiled kernels are loaded once in a server's life
        prepare(task, options)
    start = time.perf_counter()
    mover = kind(task, **options)
    setup = time.perf_counter() - start
    this = os.getpid()
    seconds, processor = [], []
    for step in range(task.steps):
        start, used = time.perf_counter(), cpu_seconds(this)
        positions = mover.move(step)
        seconds.append(time.perf_counter() - start)
        processor.append(cpu_seconds(this) - used)
        np.save(step_file(folder, step), positions)
    return Measurement(setup, seconds, processor, peak_memory(this))


def main(arguments: list[str]) -> None:
    """Run the command line that the module's docstring describes."""
    place, options, task, folder = arguments
    module, name = place.split(":")
    kind = getattr(importlib.import_module(module), name)
    measure(kind, json.loads(options), Task.load(Path(task)), Path(folder)).save(Path(folder))


if __name__ == "__main__":
    main(sys.argv[1:])
