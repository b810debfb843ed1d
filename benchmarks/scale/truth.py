"""The large motion with all boundary nodes as centres: ``python -m benchmarks.scale.truth CASE FOLDER REPEAT``.

The reference for the two-scale solver. The system is solved by conjugate gradients to rounding and never stored: this
takes a minute on M4, where dense matrices take several minutes and 5 GB. Prints JSON.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from mesh_motion_numerics.method import Method
from mesh_motion_numerics.quality.metrics import cell_quality

from benchmarks.one_scale import in_one_scale
from benchmarks.scale.cases import CASES, Case
from benchmarks.scale.library import model_of, near_wall

__all__ = ["Truth", "truth"]


@dataclass(frozen=True)
class Truth:
    """Minimum size-skew after the large motion: of all cells, and of those with a moving node."""

    minimum: float
    near_wall: float


def truth(case: Case, folder: Path) -> Truth:
    """Of a case's mesh."""
    task = case.task(folder, 1)
    model = in_one_scale(model_of(task, Method(**{"quality_metric": "size-skew", **case.method})))
    reached = model.move(task.points, task.targets(0)).points
    values = cell_quality(reached, model.cells, model.reference_sizes).metric("size-skew")
    return Truth(float(values.min()), float(values[near_wall(task, model.cells)].min()))


def main(arguments: list[str]) -> None:
    """Run the command line that the module's docstring describes."""
    name, folder, _ = arguments
    print(json.dumps(asdict(truth(CASES[name], Path(folder)))))


if __name__ == "__main__":
    main(sys.argv[1:])
