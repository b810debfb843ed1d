"""Where enrichment points go: to the worst predicted cells, and apart from each other.

Points at the K worst cells would crowd in one place and oppose each other, as the thesis saw (§5.4.1). So the worst
cell comes first, and each further point goes to the bad cell that is best by (distance to the chosen ones) ×
(1 − quality): far away *and* bad.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.quality_summary import smallest

__all__ = ["Placement", "spread_placement", "worst_cell"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Cells below this quality are candidates, however many they are …
BAD_QUALITY = 0.4
#: … and at least so many cells for each point.
CANDIDATES_PER_POINT = 4
#: Radii of consecutive points, relative to R_l: wide and narrow functions together fit better than equal ones.
RADIUS_CYCLE = (1.0, 0.5, 2.0)


class Placement(NamedTuple):
    """K places for enrichment points.

    Attributes
    ----------
    cells : (K,) int array
        Numbers of the chosen cells, in the order of choice.
    points : (K, d) array, mesh length unit
        Their centres.
    radii : (K,) array, mesh length unit
    """

    cells: Ints
    points: Floats
    radii: Floats


def worst_cell(quality: Floats) -> int:
    """Number of the cell with the smallest quality (m,); of equal ones the first."""
    return int(np.argmin(quality))


def spread_placement(points: Floats, cells: CellTable, quality: Floats, *, count: int, radius: float) -> Placement:
    """Choose cells that are bad and far from each other.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
        Positions before the motion, where the enrichment functions live.
    cells : CellTable
    quality : (m,) array
        Predicted quality of each cell.
    count : int
        K; fewer points come back only if there are fewer candidates.
    radius : float, mesh length unit
        R_l; the points' radii cycle through :data:`RADIUS_CYCLE` times it.
    """
    candidates = _candidates(quality, count)
    centres = cells.centres(points, candidates)
    chosen = _spread(centres, 1.0 - np.clip(quality[candidates], -1.0, 1.0), count)
    radii = radius * np.array(RADIUS_CYCLE)[np.arange(len(chosen)) % len(RADIUS_CYCLE)]
    return Placement(candidates[chosen], centres[chosen], radii)


def _candidates(quality: Floats, count: int) -> Ints:
    """Cells below max(0.4, the 4K-th smallest quality), the worst one first, then by number."""
    bad = smallest(quality, CANDIDATES_PER_POINT * count)
    limit = max(BAD_QUALITY, float(quality[bad[-1]])) if len(bad) else BAD_QUALITY
    numbers = np.union1d(bad, np.flatnonzero(quality < limit))
    return np.concatenate([bad[:1], numbers[numbers != bad[0]]]) if len(bad) else bad


def _spread(centres: Floats, badness: Floats, count: int) -> Ints:
    """Rows chosen greedily: the first, then the largest distance × badness, until none is left at a distance."""
    chosen = [0][: min(count, len(centres))]
    distance = np.full(len(centres), np.inf)
    while 0 < len(chosen) < count:
        distance = np.minimum(distance, np.linalg.norm(centres - centres[chosen[-1]], axis=1))
        score = distance * badness
        best = int(np.argmax(score))
        if not score[best] > 0.0:
            break
        chosen.append(best)
    return np.array(chosen, dtype=np.int64)
