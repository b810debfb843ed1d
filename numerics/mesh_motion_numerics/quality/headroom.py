"""The number of further steps like the last one that a mesh admits: until a cell inverts, and until the threshold."""

from __future__ import annotations

from dataclasses import dataclass

import mesh_motion_kernels as kernels
import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import AtRest, CellsAtRest, cell_quality

__all__ = ["HORIZON", "Headroom", "headroom"]

HORIZON = 100.0
"""Number of steps beyond which nothing is predicted."""
_FIRST = 64  # number of cells that invert first; they and the worst cells decide when the threshold is reached
_HALVINGS = 12  # halvings of the way to the inversion: accurate to 0.02 % of it


@dataclass(frozen=True)
class Headroom:
    """Multiples of a step that can follow it, if every node continues in this way; ``inf`` beyond :data:`HORIZON`.

    Attributes
    ----------
    inversion : float
        Until the first cell inverts.
    threshold : float
        Until a cell of those that invert first, or of the worst ones, is below the quality threshold; 0 if the mesh
        is below it now.
    cell : int
        The cell that inverts first.
    """

    inversion: float
    threshold: float
    cell: int


def headroom(
    points: Floats, step: Floats, cells: CellTable, rest: AtRest, metric: str, threshold: float, worst: Integers
) -> Headroom:
    """The headroom of a mesh that the last ``step`` (n, d) took to ``points`` (n, d); mesh length unit.

    The determinants of corners are polynomials along the step: their first root is exact. The real motion is straight
    only if its targets are, and a correction keeps cells valid for longer than this result: it is an early warning.

    Parameters
    ----------
    rest : (m,) array or CellsAtRest
        The reference mesh, in the form of :func:`.cell_quality`.
    metric : str
        The quality metric of the ``threshold``.
    worst : (w,) int64 array
        The worst cells at ``points``: a cell that hardly changes any more may be the next below the threshold.
    """
    steps, first = kernels.first_inversions(points, step, cells.nodes, HORIZON, _FIRST)
    nodes, few, few_at_rest = _only(cells, rest, np.union1d(first, worst))
    begin, way = points[nodes], step[nodes]

    def is_above(s: float) -> bool:
        return bool(cell_quality(begin + s * way, few, few_at_rest).metric(metric).min() >= threshold)

    low, high = 0.0, min(float(steps[0]), HORIZON)
    if not is_above(0.0):
        high = 0.0
    elif is_above(high):  # a threshold below 0, or beyond the horizon
        low = high = np.inf
    else:
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if is_above(middle) else (low, middle)
    return Headroom(float(steps[0]), low, int(first[0]))


def _only(cells: CellTable, rest: AtRest, numbers: Integers) -> tuple[Integers, CellTable, AtRest]:
    """The nodes of the cells with these ascending numbers, and these cells as a mesh that has only these nodes."""
    rows = {
        block.type.name: block.nodes[numbers[(span.start <= numbers) & (numbers < span.stop)] - span.start]
        for block, span in cells.numbered
    }
    nodes = np.unique(np.concatenate([own.ravel() for own in rows.values()]))
    at_rest = rest[numbers]
    table = CellTable.from_arrays({name: np.searchsorted(nodes, own) for name, own in rows.items()})
    return nodes, table, at_rest.of_nodes(nodes) if isinstance(at_rest, CellsAtRest) else at_rest
