"""``python -m benchmarks.far_field``: displacement of all nodes, exact and within tolerances.

Prints a table: processor time of one thread, the less of two runs. Meshes that ``--meshes`` does not hold are built.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.meshes import load_or_build
from benchmarks.peers.motions import MOTIONS
from benchmarks.scale.cases import MESHES
from mesh_motion_server.numerics.interpolation.evaluation import LocalEvaluator
from mesh_motion_server.numerics.interpolation.far_field.evaluator import FarFieldEvaluator
from mesh_motion_server.numerics.interpolation.far_field.far_sum import FarSum
from mesh_motion_server.numerics.interpolation.interpolant import Interpolant, factorize

Floats = NDArray[np.float64]

TOLERANCES = (1e-3, 1e-6, 1e-9)
#: Basis function and support radius, in lengths of the moving body.
BASES = (("tps", 1.0), ("wendland-c2", 2.5))


def _best(task: Callable[[], Floats]) -> tuple[float, Floats]:
    """Processor seconds of the faster of two runs, and what came out."""
    found = []
    for _ in range(2):
        begin = time.process_time()
        values = task()
        found.append(time.process_time() - begin)
    return min(found), values


def _interpolant(mesh: str, folder: Path, basis: str, radius: float, most: int) -> tuple[Interpolant, Floats]:
    """The interpolant of the large motion, of every boundary node or evenly left out ones, and the nodes."""
    built = load_or_build(mesh, folder)
    motion = MOTIONS[MESHES[mesh]].displacements(built.points[built.moving], 1)[0]
    step = -(-(len(built.moving) + len(built.fixed)) // most)
    moving, fixed = built.moving[::step], built.fixed[::step]
    values = np.concatenate([motion[::step], np.zeros((len(fixed), built.points.shape[1]))])
    length = float(np.ptp(built.points[built.moving], axis=0).max())
    factors = factorize(
        built.points[np.concatenate([moving, fixed])], basis=basis, support_radius=radius * length, solver="dense"
    )
    return replace(factors.solve(values), largest=float(np.linalg.norm(values, axis=1).max())), built.points


def _rows(mesh: str, folder: Path, most: int) -> list[str]:
    """A line of the table for each basis and tolerance."""
    rows = []
    for basis, radius in BASES:
        interpolant, points = _interpolant(mesh, folder, basis, radius, most)
        seconds, exact = _best(lambda: LocalEvaluator(1).displacement(interpolant, points))  # noqa: B023 - called here
        head = f"| {mesh} | {len(points)} | {len(interpolant.control_points)} | {basis} | {1e3 * seconds:.0f} |"
        for tolerance in TOLERANCES:
            evaluator = FarFieldEvaluator(tolerance, 1)
            less, found = _best(lambda: evaluator.displacement(interpolant, points))  # noqa: B023 - called here
            error = float(np.linalg.norm(found - exact, axis=1).max()) / interpolant.largest
            planned = FarSum.build(interpolant, points, tolerance=tolerance * interpolant.largest)
            taken = "" if error else " (exact sums kept)"
            rows.append(
                f"{head} {tolerance:.0e} | {1e3 * less:.0f} | {seconds / less:.1f}{taken} | "
                f"{planned.bound / interpolant.largest if error else 0.0:.1e} | {error:.1e} |"
            )
    return rows


def main(words: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.far_field", description=__doc__)
    parser.add_argument("--sizes", nargs="+", default=["M2", "M3"], choices=sorted(MESHES))
    parser.add_argument("--meshes", type=Path, default=Path("out/peers"))
    parser.add_argument("--most", type=int, default=6000, help="control points, evenly left out where there are more")
    chosen = parser.parse_args(words)
    print("| mesh | nodes | control points | basis | direct, ms | tolerance | ms | times faster | bound | error |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for mesh in chosen.sizes:
        for row in _rows(mesh, chosen.meshes, chosen.most):
            print(row, flush=True)


if __name__ == "__main__":
    main()
