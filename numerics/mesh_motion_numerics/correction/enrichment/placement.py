"""Places of the enrichment points: at the worst predicted cells, and at a distance from each other.

Points at the K worst cells would all be in one place and oppose each other, as the thesis found (§5.4.1). There are two
ways to keep them apart:

- :func:`spread_placement`: the worst cell comes first, and each further point goes to the bad cell that is best by
  (distance to the chosen ones) × (1 − quality): far away *and* bad;
- :func:`local_minima`: the cells below the threshold that are no better than any of their neighbours, thesis (4.11).
"""

from typing import NamedTuple

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.quality_summary import smallest

#: Cells below this quality are candidates …
BAD_QUALITY = 0.4
#: … and at least this number of cells for each point.
CANDIDATES_PER_POINT = 4
#: Radii of consecutive points, relative to R_l: a mix of wide and narrow functions fits better than equal radii.
RADIUS_CYCLE = (1.0, 0.5, 2.0)


class Placement(NamedTuple):
    """K places for enrichment points."""

    cells: Integers  # (K,). Numbers of the chosen cells, in the order of choice
    points: Floats  # (K, d), mesh length unit. Their centres
    radii: Floats  # (K,), mesh length unit


def spread_placement(points: Floats, cells: CellTable, quality: Floats, *, count: int, radius: float) -> Placement:
    """Choose cells that are bad and far from each other.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
        Positions before the motion, where the enrichment functions live.
    quality : (m,) array
        Predicted quality of each cell.
    count : int
        K; fewer points are returned only if there are fewer candidates.
    radius : float, mesh length unit
        R_l; the points' radii cycle through :data:`RADIUS_CYCLE` times it.
    """
    candidates = _candidates(quality, count)
    centres = cells.centres(points, candidates)
    chosen = _spread(centres, 1.0 - np.clip(quality[candidates], -1.0, 1.0), count)
    radii = radius * np.array(RADIUS_CYCLE)[np.arange(len(chosen)) % len(RADIUS_CYCLE)]
    return Placement(candidates[chosen], centres[chosen], radii)


def local_minima(cells: CellTable, quality: Floats, threshold: float) -> Integers:
    """Cells below a threshold that are no better than any cell that shares a node with them, the worst first.

    Thesis (4.11) on a mesh: ∂f/∂x = 0 and ∂²f/∂x² > 0 where the predicted quality f is sampled at the cells. Among
    neighbours of equal quality the first counts.

    Parameters
    ----------
    quality : (m,) array
    """
    rank = np.empty(len(quality), dtype=np.int64)
    rank[np.argsort(quality, kind="stable")] = np.arange(len(quality))
    lowest = np.full(1 + max(int(block.nodes.max()) for block in cells), len(quality))
    for block, span in cells.numbered:
        np.minimum.at(lowest, block.nodes, rank[span, None])
    around = np.concatenate([lowest[block.nodes].min(axis=1) for block in cells])
    found = np.flatnonzero((rank == around) & (quality < threshold))
    return np.asarray(found[np.argsort(rank[found])])


def gap_middle(points: Floats, cells: CellTable, quality: Floats, held: Marks) -> Floats:
    """(1, 1) middle between the two boundary nodes that bracket the worst cell, in 1D: thesis §4.3.1."""
    place = cells.centres(points, np.array([np.argmin(quality)]))[0, 0]
    x = np.sort(points[held, 0])
    gap = int(np.clip(np.searchsorted(x, place), 1, len(x) - 1))
    return np.array([[0.5 * (x[gap - 1] + x[gap])]])


def _candidates(quality: Floats, count: int) -> Integers:
    """Cells below max(0.4, the 4K-th smallest quality), the worst one first, then by number."""
    bad = smallest(quality, CANDIDATES_PER_POINT * count)
    limit = max(BAD_QUALITY, float(quality[bad[-1]])) if len(bad) else BAD_QUALITY
    numbers = np.union1d(bad, np.flatnonzero(quality < limit))
    return np.concatenate([bad[:1], numbers[numbers != bad[0]]]) if len(bad) else bad


def _spread(centres: Floats, badness: Floats, count: int) -> Integers:
    """Rows chosen greedily: the first, then the largest distance × badness, until all distances are zero."""
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
