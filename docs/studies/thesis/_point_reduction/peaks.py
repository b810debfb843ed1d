"""Local maxima of the error over a boundary, with neighbours taken by distance."""

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from scipy.spatial import cKDTree

__all__ = ["error_peaks", "nearest_neighbours"]


#: Nearest nodes that count as neighbours, by dimension: both sides of a curve twice, the ring around a surface node.
_NEIGHBOURS = {1: 2, 2: 4, 3: 8}


def nearest_neighbours(points: Floats) -> Integers:
    """(n, m) nearest other nodes of (n, d) points; fewer columns if there are fewer points."""
    count = min(_NEIGHBOURS[points.shape[1]], len(points) - 1)
    if count < 1:
        return np.empty((len(points), 0), dtype=np.int64)
    found = cKDTree(points).query(points, k=np.arange(1, count + 2))[1]
    return np.asarray(found[:, 1:], dtype=np.int64)


def error_peaks(size: Floats, neighbours: Integers) -> Integers:
    """Nodes whose error ``size`` (n,) no neighbour exceeds, the largest first; of equal neighbours the first counts.

    Two nodes are neighbours if one of them has the other among its nearest nodes.
    """
    own = np.arange(len(size))[:, None]
    around = size[neighbours]
    exceeded = (around > size[:, None]) | ((around == size[:, None]) & (neighbours < own))
    lower = exceeded.any(axis=1)
    lower[neighbours[~exceeded]] = True
    peaks = np.flatnonzero(~lower)
    return peaks[np.argsort(-size[peaks], kind="stable")]
