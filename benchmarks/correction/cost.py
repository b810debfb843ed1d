"""Measure one case in this process: ``python -m benchmarks.correction.cost CASE FOLDER REPEAT`` prints JSON.

The limit is the minimum work of any such method: in every iteration one gradient and one Hessian of the free region
with all blocks recomputed, and one quality computation of every cell of the mesh. It is timed in the same process.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from mesh_motion_numerics.blas import one_blas_thread
from mesh_motion_numerics.correction.region_measure import region_measure
from mesh_motion_numerics.correction.trial_nodes import LEVELS, Polished, TrialMesh, polish, reach
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import reference_sizes
from numpy.typing import NDArray

from benchmarks.correction.cases import CASES, Case, standard_positions
from benchmarks.peers.measurement import peak_memory

__all__ = ["Cost", "measured"]

Floats = NDArray[np.float64]

_A_LITTLE, _VALID = 1.02, 1e-6


@dataclass(frozen=True)
class Cost:
    """Of one correction.

    Attributes
    ----------
    nodes, free, freed : int
        Of the mesh; that may move; that were free at the end.
    standard, minimum : float
        Minimum size-skew before and after.
    seconds, cpu_seconds : float
        The shortest of the repeats.
    limit_cpu_seconds : float
        Of the work that cannot be spared, see the module.
    peak_bytes : int
        Largest resident set up to the end of the correction, with the mesh and the libraries.
    """

    nodes: int
    free: int
    freed: int
    standard: float
    minimum: float
    iterations: int
    seconds: float
    cpu_seconds: float
    limit_cpu_seconds: float
    peak_bytes: int


def trial_mesh(case: Case, folder: Path) -> TrialMesh:
    """The input of the correction: the mesh after the standard motion."""
    mesh = case.read_mesh(folder)
    cells = CellTable.from_arrays(mesh.cells)
    held = np.zeros(len(mesh.points), dtype=bool)
    held[mesh.moving] = held[mesh.fixed] = True
    return TrialMesh(mesh.points, cells, reference_sizes(mesh.points, cells), held)


def corrected(points: Floats, mesh: TrialMesh, target: float) -> Polished:
    """Correct the mesh: all nodes are free for the maximum, a growing region for a threshold."""
    with one_blas_thread():
        if np.isinf(target):
            return polish(points, mesh, mesh.free(~mesh.held))
        return reach(points, mesh, target)


def measured(case: Case, folder: Path, repeat: int) -> Cost:
    """The cost of a case."""
    points, mesh = standard_positions(case, folder), trial_mesh(case, folder)
    standard = float(mesh.quality(points).min())
    corrected(points, mesh, max(_A_LITTLE * standard, _VALID))  # loads the compiled kernels, as a server does once
    runs = [_timed(lambda: corrected(points, mesh, case.target)) for _ in range(repeat)]
    peak = peak_memory(os.getpid())
    found = runs[0][2]
    return Cost(
        nodes=len(points),
        free=int(np.count_nonzero(~mesh.held)),
        freed=found.freed,
        standard=standard,
        minimum=float(mesh.quality(found.points).min()),
        iterations=found.iterations,
        seconds=min(run[0] for run in runs),
        cpu_seconds=min(run[1] for run in runs),
        limit_cpu_seconds=_limit(points, mesh, found),
        peak_bytes=peak,
    )


def _timed(task: Callable[[], Polished]) -> tuple[float, float, Polished]:
    """Wall time, processor time, result."""
    wall, used = time.perf_counter(), time.process_time()
    found = task()
    return time.perf_counter() - wall, time.process_time() - used, found


def _limit(points: Floats, mesh: TrialMesh, found: Polished) -> float:
    """Processor time of the derivatives of every iteration, and of one quality computation of the mesh, seconds."""
    everything = mesh.free(~mesh.held)
    local = found.points[everything.nodes]
    measure = region_measure(everything, LEVELS[0])
    _, weights = measure.mean(local)

    def derivatives() -> None:
        measure.gradient(local, weights)
        measure.hessian(local, weights, refresh=0.0, floor=0.1)

    whole = _shortest(derivatives)
    share = sum(stage.iterations * stage.free for stage in found.history) / everything.n_free
    return whole * share + _shortest(lambda: mesh.quality(points))


def _shortest(task: Callable[[], object], repeat: int = 3) -> float:
    """Processor time of a task, the shortest of some runs."""
    best = float("inf")
    for _ in range(repeat):
        used = time.process_time()
        task()
        best = min(best, time.process_time() - used)
    return best


def main(arguments: list[str]) -> None:
    """Run the command line that the module's docstring describes."""
    name, folder, repeat = arguments
    print(json.dumps(asdict(measured(CASES[name], Path(folder), int(repeat)))))


if __name__ == "__main__":
    main(sys.argv[1:])
