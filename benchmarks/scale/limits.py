"""The machine's limits, measured in this process: ``python -m benchmarks.scale.limits`` prints JSON.

For one thread and for all threads it measures bytes per second that a compiled triad moves and a compiled sum reads,
fused multiply-adds per second, and pairs of Wendland's C2 function per second (``machine.cpp``, compiled here for this
machine). It also measures the rate of the textbook's sum in numpy, the common reference for runs on different machines.
"""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from functools import cache
from pathlib import Path

import mesh_motion_kernels as kernels
import numpy as np
from mesh_motion_numerics.blas import one_blas_thread

from benchmarks.peers.movers.dense_rbf import wendland_matrix
from benchmarks.scale.figures import MachineLimits, Rates, Seconds, of_threads, timed

__all__ = ["machine_limits", "rates"]

_REPEAT = 15
_PAIRS = 2048  # nodes and centres of a tile, as the dense mover's
_TILES = 16  # of them for the compiled loop: enough that the start of threads takes no time in comparison
_HORNER_NUMBERS = 256  # stay in the first cache
_HORNER_FLOPS = 128  # of each number
# the parts of -ffast-math, not the option itself: it links code that flushes denormals in the whole process that loads
# the library, and then SciPy's trees grow without end
_FAST = "-fassociative-math -freciprocal-math -ffinite-math-only -fno-signed-zeros -fno-trapping-math -fno-math-errno"
_FLAGS = ("-std=c++17", "-O3", "-march=native", *_FAST.split(), "-pthread", "-shared", "-fPIC")


def machine_limits(numbers: int = 16_000_000) -> MachineLimits:
    """Measure the limits; the moved arrays have ``numbers`` f64 values, more than any cache holds."""
    copy = _copy(numbers)
    rng = np.random.default_rng(0)
    points, centres, weights = rng.random((_PAIRS, 3)), rng.random((_PAIRS, 3)), rng.random((_PAIRS, 3))
    with one_blas_thread():
        dense = _shortest(lambda: wendland_matrix(points, centres, 2.5) @ weights)
    threads = int(kernels.available_threads())
    return MachineLimits(
        bandwidth=2 * 8 * numbers / copy.cpu,
        pair_rate=_PAIRS**2 / dense.cpu,
        one=rates(1, numbers),
        all=rates(threads, numbers),
        threads=threads,
    )


def _copy(numbers: int) -> Seconds:
    source, target = np.ones(numbers), np.zeros(numbers)
    return _shortest(lambda: np.copyto(target, source))


@cache
def _machine() -> ctypes.CDLL:
    """The loops of ``machine.cpp``."""
    compiler = next(filter(None, map(shutil.which, (os.environ.get("CXX", "c++"), "c++", "g++", "clang++"))), None)
    if compiler is None:
        raise SystemExit("the machine's limits need a C++ compiler: install g++ or clang++, or name yours in CXX")
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "machine.so"
        subprocess.run([compiler, *_FLAGS, Path(__file__).with_name("machine.cpp"), "-o", library], check=True)
        return ctypes.CDLL(str(library))


def rates(threads: int, numbers: int = 16_000_000) -> Rates:
    """Rates of the compiled loops by wall time; on one thread by processor time, since load disturbs it less."""
    a, b, c = np.zeros(numbers), np.ones(numbers), np.ones(numbers)
    sums, few = np.empty(threads), np.linspace(0.0, 0.5, _HORNER_NUMBERS)
    turns = max(numbers // 1000, 160) // threads + 1
    rng = np.random.default_rng(0)
    points, centres = rng.random((_TILES * _PAIRS, 3)), rng.random((3, _PAIRS))
    moved = np.empty_like(points)

    def seconds(loop: str, *arguments: np.ndarray | int) -> float:
        given = [x.ctypes if isinstance(x, np.ndarray) else ctypes.c_longlong(x) for x in (*arguments, threads)]
        task = getattr(_machine(), loop)
        return of_threads(_shortest(lambda: task(*given)), threads)

    return Rates(
        triad=24 * numbers / seconds("triad", a, b, c, numbers),
        read=8 * numbers / seconds("read_all", a, numbers, sums),
        arithmetic=_HORNER_FLOPS * few.size * turns * threads / seconds("horner", few, few.size, turns, sums),
        pairs=len(points) * _PAIRS / seconds("basis_sums", points, len(points), centres, centres, _PAIRS, moved),
    )


def _shortest(task: Callable[[], object]) -> Seconds:
    """Shortest time of some runs, after a first run that fills caches."""
    task()
    return Seconds.shortest([timed(task)[0] for _ in range(_REPEAT)])


if __name__ == "__main__":
    print(json.dumps(asdict(machine_limits())))
