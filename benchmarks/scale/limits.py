"""The machine's limits, measured in this process: ``python -m benchmarks.scale.limits`` prints JSON.

Of one thread and of all: bytes a second that a compiled triad moves and a compiled sum reads, fused multiply-adds a
second, pairs of Wendland's C2 function a second. And what the textbook's sum does in numpy, which is the yardstick that
runs on different machines have in common.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict

import numba
import numpy as np

from benchmarks.peers.movers.dense_rbf import wendland_matrix
from benchmarks.scale.figures import MachineLimits, Rates, Seconds, timed
from benchmarks.scale.machine_kernels import HORNER_FLOPS, basis_sums, horner, read, triad
from mesh_motion_server.numerics.blas import one_blas_thread

__all__ = ["machine_limits", "rates"]

_REPEAT = 15
_PAIRS = 2048  # nodes and centres of a tile, as the dense mover's
_BLOCKS = 16  # work items of the compiled loops
_HORNER_NUMBERS = 256  # stay in the first cache


def machine_limits(numbers: int = 16_000_000) -> MachineLimits:
    """The moved arrays have so many f64 numbers, which no cache should hold."""
    copy = _copy(numbers)
    rng = np.random.default_rng(0)
    points, centres, weights = rng.random((_PAIRS, 3)), rng.random((_PAIRS, 3)), rng.random((_PAIRS, 3))
    with one_blas_thread():
        dense = _shortest(lambda: wendland_matrix(points, centres, 2.5) @ weights)
    threads = int(numba.get_num_threads())
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


def rates(threads: int, numbers: int = 16_000_000) -> Rates:
    """Of the compiled loops on so many threads, by wall time; of one thread by processor time, as load hides less."""
    before = numba.get_num_threads()
    numba.set_num_threads(threads)
    try:
        a, b, c = np.zeros(numbers), np.ones(numbers), np.ones(numbers)
        sums, few = np.empty(_BLOCKS), np.linspace(0.0, 0.5, _HORNER_NUMBERS)
        turns = max(numbers // 16_000, 10)
        rng = np.random.default_rng(0)
        points, centres = rng.random((_PAIRS, 3)), rng.random((3, _PAIRS))
        moved = np.empty_like(points)
        operations = HORNER_FLOPS * _HORNER_NUMBERS * turns * _BLOCKS

        def seconds(task: Callable[[], object]) -> float:
            shortest = _shortest(task)
            return shortest.cpu if threads == 1 else shortest.wall

        return Rates(
            triad=24 * numbers / seconds(lambda: triad(a, b, c, _BLOCKS)),
            read=8 * numbers / seconds(lambda: read(a, _BLOCKS, sums)),
            arithmetic=operations / seconds(lambda: horner(few, turns, _BLOCKS, sums)),
            pairs=_PAIRS**2 / seconds(lambda: basis_sums(points, centres, centres, moved)),
        )
    finally:
        numba.set_num_threads(before)


def _shortest(task: Callable[[], object]) -> Seconds:
    """Of some runs; the first one compiles."""
    task()
    return Seconds.shortest([timed(task)[0] for _ in range(_REPEAT)])


if __name__ == "__main__":
    print(json.dumps(asdict(machine_limits())))
