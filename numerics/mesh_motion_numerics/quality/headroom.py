"""The number of further steps like the last one that a mesh admits: until a cell inverts, and until the threshold."""

from __future__ import annotations

from dataclasses import dataclass

import mesh_motion_kernels as kernels
import numpy as np

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import AtRest, subset_quality
from mesh_motion_numerics.quality.quality_summary import smallest

__all__ = ["HORIZON", "Headroom", "headroom"]

HORIZON = 100.0
"""Number of steps beyond which nothing is predicted."""
_FIRST = 64  # number of cells that invert first; they decide when the threshold is reached
_HALVINGS = 12  # halvings of the way to the inversion: accurate to 0.02 % of it


@dataclass(frozen=True)
class Headroom:
    """Multiples of a step that can follow it, if every node continues in this way; ``inf`` beyond :data:`HORIZON`.

    Attributes
    ----------
    inversion : float
        Until the first cell inverts.
    threshold : float
        Until a cell of those that invert first is below the quality threshold; 0 if the mesh is below it now.
    cell : int
        The cell that inverts first.
    """

    inversion: float
    threshold: float
    cell: int


def headroom(points: Floats, step: Floats, cells: CellTable, rest: AtRest, metric: str, threshold: float) -> Headroom:
    """The headroom of a mesh that the last ``step`` (n, d) took to ``points`` (n, d); mesh length unit.

    The determinants of corners are polynomials along the step: their first root is exact. The real motion is straight
    only if its targets are, and a correction keeps cells valid for longer than this result: it is an early warning.

    Parameters
    ----------
    rest : (m,) array or CellsAtRest
        The reference mesh, in the form of :func:`.subset_quality`.
    metric : str
        The quality metric of the ``threshold``.
    """
    steps = np.empty(len(cells))
    for block, rows in cells.numbered:
        kernels.steps_to_inversion(
            points, step, np.ascontiguousarray(block.nodes), block.type.corner_array, HORIZON, steps[rows]
        )
    first = smallest(steps, min(_FIRST, len(steps)))

    def is_above(s: float) -> bool:
        there = subset_quality(points + s * step, cells, rest, first)
        return bool(there.metric(metric).min() >= threshold)

    low, high = 0.0, min(float(steps[first[0]]), HORIZON)
    if not is_above(0.0):
        high = 0.0
    elif is_above(high):  # a threshold below 0, or beyond the horizon
        low = high = np.inf
    else:
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if is_above(middle) else (low, middle)
    return Headroom(float(steps[first[0]]), low, int(first[0]))
