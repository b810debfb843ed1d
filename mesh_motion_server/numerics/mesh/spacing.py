"""The distance between neighbouring points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

__all__ = ["local_spacing"]


def local_spacing(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) distance of each of (n, d) points to its nearest neighbour, mesh length unit; infinite for a single one."""
    if len(points) < 2:
        return np.full(len(points), np.inf)
    return np.asarray(cKDTree(points).query(points, k=2)[0][:, 1])
