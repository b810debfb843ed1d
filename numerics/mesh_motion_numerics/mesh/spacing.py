"""The distance between neighbouring points."""

import numpy as np
from scipy.spatial import cKDTree

from mesh_motion_numerics.arrays import Floats

__all__ = ["local_spacing"]


def local_spacing(points: Floats) -> Floats:
    """(n,) distance of each of (n, d) points to its nearest neighbour, mesh length unit; inf for a single point."""
    if len(points) < 2:
        return np.full(len(points), np.inf)
    return np.asarray(cKDTree(points).query(points, k=2)[0][:, 1])
