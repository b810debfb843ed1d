"""The machine's limits, measured in this process: ``python -m benchmarks.scale.limits`` prints JSON."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict

import numpy as np

from benchmarks.peers.movers.dense_rbf import wendland_matrix
from benchmarks.scale.figures import MachineLimits, Seconds, timed
from mesh_motion_server.numerics.blas import one_blas_thread

__all__ = ["machine_limits"]

_REPEAT = 15
_PAIRS = 2048  # nodes and centres of a tile, as the dense mover's


def machine_limits(numbers: int = 16_000_000) -> MachineLimits:
    """Of one thread; the copied array has so many f64 numbers, which no cache should hold."""
    source, target = np.ones(numbers), np.zeros(numbers)
    copy = _shortest(lambda: np.copyto(target, source))
    rng = np.random.default_rng(0)
    points, centres, weights = rng.random((_PAIRS, 3)), rng.random((_PAIRS, 3)), rng.random((_PAIRS, 3))
    with one_blas_thread():
        dense = _shortest(lambda: wendland_matrix(points, centres, 2.5) @ weights)
    return MachineLimits(2 * source.nbytes / copy.cpu, _PAIRS**2 / dense.cpu)


def _shortest(task: Callable[[], object]) -> Seconds:
    """Of some runs."""
    return Seconds.shortest([timed(task)[0] for _ in range(_REPEAT)])


if __name__ == "__main__":
    print(json.dumps(asdict(machine_limits())))
