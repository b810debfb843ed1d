"""Which control points carry the motion into the volume.

Of few control points all do that are far enough from each other for the matrix to bear it (:func:`separated_points`).
Of many, farthest-first with distances measured in the local spacing of the boundary (:func:`coarse_points`): the mesher
put many nodes where detail matters, so a small body in a wide domain gets as large a share of the coarse points as of
the nodes, and no part of any surface is left out.
"""

import mesh_motion_kernels as kernels
import numpy as np
from scipy.spatial import cKDTree

from mesh_motion_numerics.arrays import Floats, Integers, Marks

__all__ = ["coarse_points", "separated_points"]


_MOVING_SHARE = 0.6


def separated_points(points: Floats, separation: float, first: Integers | None = None) -> Integers:
    """Points (m,), ascending, of which no two are closer than the separation and to which every other one is.

    Parameters
    ----------
    points : (n, 3) array, mesh length unit
    separation : float, mesh length unit
    first : (f,) int64 array, optional
        Points that are taken if they are far enough from each other, before any other; otherwise the lower number.
    """
    order = np.arange(len(points))
    if first is not None:
        order = np.concatenate([first, np.setdiff1d(order, first, assume_unique=True)])
    # one of each cell, the first, keeps the pairs few; cells are so small that those of one are too close to each other
    cells = np.floor((points[order] - points.min(axis=0)) * (np.sqrt(3.0) / separation)).astype(np.int64)
    candidates = order[np.sort(np.unique(cells, axis=0, return_index=True)[1])]
    pairs = cKDTree(points[candidates]).query_pairs(separation, output_type="ndarray")
    taken = np.full(len(candidates), True)
    kernels.drop_followers(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))], taken)
    return np.sort(candidates[taken])


def coarse_points(points: Floats, spacing: Floats, moving: Marks, count: int, separation: float = 0.0) -> Integers:
    """Choose up to ``count`` control points, if there are as many three moving ones to two at rest.

    The field is steepest between the moving body and what is near it; walls at rest need points only so that the field
    vanishes there.

    Parameters
    ----------
    points : (n, 3) array, mesh length unit
    spacing : (n,) array, mesh length unit
    moving : (n,) bool array
    separation : float, mesh length unit
        Least distance of two of them.

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
