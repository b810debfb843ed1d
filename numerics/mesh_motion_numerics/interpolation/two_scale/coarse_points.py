"""The choice of the control points that carry the motion into the volume.

If there are few control points, all are used that are far enough from each other to keep the matrix regular
(:func:`separated_points`). If there are many, the farthest point is chosen next, with distances in units of the
boundary's local spacing (:func:`coarse_points`). The mesh has many nodes where detail matters, so a small body in a
wide domain gets as large a share of the coarse points as of the nodes, and no part of a surface is left out.
"""

import mesh_motion_kernels as kernels
import numpy as np
from scipy.spatial import cKDTree

from mesh_motion_numerics.arrays import Floats, Integers, Marks

_MOVING_SHARE = 0.6


def separated_points(points: Floats, separation: float, first: Integers | None = None) -> Integers:
    """Points (m,), ascending: no two are closer than the separation, and every other point is close to one of them.

    Parameters
    ----------
    points : (n, 3) array, mesh length unit
    separation : float, mesh length unit
    first : (f,) int64 array, optional
        Points with priority, if they are far enough from each other; without priority the lower number is taken first.
    """
    order = np.arange(len(points))
    if first is not None:
        order = np.concatenate([first, np.setdiff1d(order, first, assume_unique=True)])
    # the first point of each cell keeps the pairs few; cells are so small that all their points are too close to each
    # other
    cells = np.floor((points[order] - points.min(axis=0)) * (np.sqrt(3.0) / separation)).astype(np.int64)
    candidates = order[np.sort(np.unique(cells, axis=0, return_index=True)[1])]
    pairs = cKDTree(points[candidates]).query_pairs(separation, output_type="ndarray")
    taken = np.full(len(candidates), True)
    kernels.drop_followers(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))], taken)
    return np.sort(candidates[taken])


def coarse_points(points: Floats, spacing: Floats, moving: Marks, count: int, separation: float = 0.0) -> Integers:
    """Choose up to ``count`` control points, with three moving ones to two at rest, if there are enough.

    The field is steepest between the moving body and its surroundings; walls at rest need points only to make the field
    0 there.

    Parameters
    ----------
    points : (n, 3) array, mesh length unit
    spacing : (n,) array, mesh length unit
    moving : (n,) bool array
    separation : float, mesh length unit
        Smallest distance of two chosen points.

    Returns
    -------
    (m,) int64 array
        Ascending.

    Notes
    -----
    Ties go to the lower number. O(n · count) time.
    """
    body, rest = np.flatnonzero(moving), np.flatnonzero(~moving)
    share = min(max(round(_MOVING_SHARE * count), count - len(rest)), len(body))
    chosen = _farthest_first(points, spacing, body, share, separation)
    if separation > 0.0 and len(chosen):
        rest = rest[cKDTree(points[chosen]).query(points[rest], distance_upper_bound=separation)[0] >= separation]
    return np.sort(np.concatenate([chosen, _farthest_first(points, spacing, rest, count - share, separation)]))


def _farthest_first(points: Floats, spacing: Floats, candidates: Integers, count: int, separation: float) -> Integers:
    """Numbers of up to ``count`` of the candidates."""
    chosen = np.empty(min(count, len(candidates)), dtype=np.int64)
    if len(chosen) == len(candidates) and separation == 0.0:
        return candidates
    weights = 1.0 / np.maximum(spacing[candidates], separation) ** 2
    places = np.ascontiguousarray(points[candidates])
    return candidates[chosen[: kernels.choose_farthest(places, weights, separation**2, chosen)]]
