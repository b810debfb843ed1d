"""The number of further steps like the last one that a mesh admits: until a cell inverts, and until the threshold."""

from __future__ import annotations

from dataclasses import dataclass

import mesh_motion_kernels as kernels
import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import AtRest, judged

HORIZON = 100.0
"""Number of steps beyond which nothing is predicted."""
_FIRST = 64  # number of cells that invert first; they and the worst cells decide when the threshold is reached
_PLACES, _ROUNDS = 17, 2  # on the way to the inversion, then on the part with the threshold, which is nearly straight
_NEAR, _MORE = 6.0, 1.5  # from so many steps on, resisting cells keep the threshold for longer: at most by this factor


@dataclass(frozen=True)
class Headroom:
    """Multiples of a step that can follow it, if every node continues in this way; ``inf`` beyond :data:`HORIZON`."""

    inversion: float  # Until the first cell inverts; with the smooth correction, until none can be valid
    #: Until a cell of those that invert first, or of the worst ones, is below the quality threshold; 0 if the mesh is
    #: below it now.
    threshold: float
    cell: int  # The cell that inverts first if all nodes go straight on


def headroom(
    points: Floats,
    before: Floats,
    cells: CellTable,
    rest: AtRest,
    metric: str,
    threshold: float,
    worst: Integers,
    near: Integers,
    resisting: bool = False,
) -> Headroom:
    """The headroom of a mesh whose last step went from ``before`` (n, d) to ``points`` (n, d); mesh length unit.

    The determinants of corners are polynomials along the step: their first root is exact. The real motion is straight
    only if its targets are, and a correction keeps cells valid for longer: this result is an early warning
    (:mod:`.contact_ahead` has the end of the smooth one).

    Parameters
    ----------
    rest : (m,) array or CellsAtRest
        The reference mesh, in the form of :func:`.cell_quality`.
    metric : str
        The quality metric of the ``threshold``.
    worst : (w,) int64 array
        The worst cells at ``points``: a cell that hardly changes any more may be the next below the threshold.
    near : (k,) int64 array
        Ascending; in a large mesh these cells are always looked at, and the others if neighbours invert early.
    resisting : bool
        Whether a correction slows the loss of cells near the threshold. In the run's last steps the quality of each
        cell then falls more evenly than on straight ways: its fall in this step counts.
    """
    worst = np.sort(worst)
    near = np.insert(near, np.searchsorted(near, worst), worst)
    steps, first = kernels.first_inversions(points, before, cells.nodes, near, HORIZON, _FIRST)
    arrays, deciding = judged(points, cells, rest, metric), np.union1d(first, worst)

    def qualities(places: Floats) -> Floats:
        """(p, c) qualities of the deciding cells."""
        values: Floats = kernels.values_along(arrays[0], before, *arrays[1:], deciding, places)
        return values

    low, high = 0.0, min(float(steps[0]), HORIZON)
    for _ in range(_ROUNDS):
        places = np.linspace(low, high, _PLACES)
        values = qualities(places).min(axis=1)
        below = np.flatnonzero(~(values >= threshold))
        if not len(below) or below[0] == 0:  # a threshold below 0, or beyond the horizon; or below it now
            low = 0.0 if len(below) else np.inf
            break
        low, high = places[below[0] - 1 : below[0] + 1]
    else:
        above, under = values[below[0] - 1 : below[0] + 1]
        low += (high - low) * (above - threshold) / (above - under)
        if resisting and low < _NEAR:
            start, now = qualities(np.array([-1.0, 0.0]))
            falling = now < start
            even = (now - threshold)[falling] / (start - now)[falling]
            low = max(low, min(_MORE * low, even.min(initial=np.inf)))
    return Headroom(float(steps[0]), float(low), int(first[0]))
