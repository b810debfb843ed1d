"""The closest point of a set of segments or triangles.

A k-d tree of the facets' centroids bounds the search: the closest facet's centroid lies no farther away than the
nearest centroid plus the largest facet's radius. Among those candidates the closest point is exact; ties go to the
lowest facet.

References
----------
C. Ericson, *Real-Time Collision Detection*, Morgan Kaufmann 2005, §5.1.5 (closest point on a triangle).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mesh_motion_server.numerics.centres import padded
from mesh_motion_server.numerics.threads import threads_for

__all__ = ["FacetSet", "nearest_within"]

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def _dot(a: Array, b: Array) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@njit(cache=True, error_model="numpy")
def _on_segment(p: Array, a: Array, b: Array, out: Array) -> None:
    """Closest point of the segment ab."""
    ab = b - a
    length = _dot(ab, ab)
    t = min(max(_dot(p - a, ab) / length, 0.0), 1.0) if length > 0.0 else 0.0
    for i in range(3):
        out[i] = a[i] + t * ab[i]


@njit(cache=True, error_model="numpy")
def _on_triangle(p: Array, a: Array, b: Array, c: Array, out: Array) -> None:
    """Closest point of the triangle abc: inside if the barycentric coordinates are positive, else on an edge."""
    ab, ac, ap = b - a, c - a, p - a
    d00, d01, d11 = _dot(ab, ab), _dot(ab, ac), _dot(ac, ac)
    d20, d21 = _dot(ap, ab), _dot(ap, ac)
    det = d00 * d11 - d01 * d01
    if det > 0.0:
        v, w = (d11 * d20 - d01 * d21) / det, (d00 * d21 - d01 * d20) / det
        if v >= 0.0 and w >= 0.0 and v + w <= 1.0:
            for i in range(3):
                out[i] = a[i] + v * ab[i] + w * ac[i]
            return
    best, trial = np.inf, np.empty(3)
    for side in range(3):
        _on_segment(p, (a, b, c)[side], (b, c, a)[side], trial)
        away = p - trial
        if _dot(away, away) < best:
            best = _dot(away, away)
            out[:] = trial


@njit(cache=True, error_model="numpy", parallel=True)
def _closest(
    points: Array,
    corners: Array,
    starts: NDArray[np.int64],
    candidates: NDArray[np.int64],
    out: Array,
    facets: NDArray[np.int64],
) -> None:
    """``out[i]``: the point nearest to ``points[i]`` on ``candidates[starts[i]:starts[i + 1]]``, and its facet."""
    for i in prange(points.shape[0]):
        best, trial = np.inf, np.empty(3)
        for at in range(starts[i], starts[i + 1]):
            facet = corners[candidates[at]]
            if facet.shape[0] == 2:
                _on_segment(points[i], facet[0], facet[1], trial)
            else:
                _on_triangle(points[i], facet[0], facet[1], facet[2], trial)
            away = points[i] - trial
            if _dot(away, away) < best:
                best = _dot(away, away)
                out[i], facets[i] = trial, candidates[at]


class FacetSet:
    """Segments (2D, or curves in 3D) or triangles.

    Parameters
    ----------
    corners : (f, 2 or 3, d) array, mesh length unit
        f > 0.
    """

    def __init__(self, corners: Array) -> None:
        facets, width, self._dimension = corners.shape
        self._corners = padded(corners.reshape(-1, self._dimension)).reshape(facets, width, 3)
        centroids = self._corners.mean(axis=1)
        away = self._corners - centroids[:, None]
        self._reach = float(np.sqrt(np.max(np.sum(away * away, axis=2))))
        self._tree = cKDTree(centroids)

    def closest(self, points: Array) -> Array:
        """(n, d) points of the facets nearest to (n, d) points."""
        return self.nearest(points)[0]

    def nearest(self, points: Array) -> tuple[Array, NDArray[np.int64]]:
        """(n, d) points of the facets nearest to (n, d) points, and the row (n,) of the facet each lies on."""
        facets = np.zeros(len(points), dtype=np.int64)
        if not len(points):
            return points.copy(), facets
        places = padded(points)
        nearest = self._tree.query(places)[0]
        lists = self._tree.query_ball_point(places, (nearest + self._reach) * (1.0 + 1e-12), return_sorted=True)
        starts = np.zeros(len(points) + 1, dtype=np.int64)
        np.cumsum([len(candidates) for candidates in lists], out=starts[1:])
        out = np.empty_like(places)
        with threads_for(10.0 * starts[-1]):  # a facet costs about ten basis functions
            _closest(places, self._corners, starts, np.concatenate(lists).astype(np.int64), out, facets)
        return np.ascontiguousarray(out[:, : self._dimension]), facets


def nearest_within(corners: Array, points: Array, distance: float) -> tuple[Array, NDArray[np.int64]]:
    """The nearest facets of widely different sizes, no farther than a distance.

    A search is as wide as the largest facet: those of a far field would have it look everywhere. So facets are searched
    by octaves of their radius.

    Parameters
    ----------
    corners : (f, 2 or 3, d) array, mesh length unit
        f may be 0.
    points : (n, d) array, mesh length unit
    distance : float, mesh length unit

    Returns
    -------
    (n, d) array, (n,) int64 array
        The nearest points of facets, and the facets' rows; NaN and −1 where none is near.
    """
    places, facets = np.full(points.shape, np.nan), np.full(len(points), -1, dtype=np.int64)
    best = np.full(len(points), np.inf)
    for octave, radius in _by_size(corners):
        centres = corners[octave].mean(axis=1)
        rows = _near(points, centres, distance + radius)
        if not len(rows):
            continue
        own = octave[_near(centres, points[rows], distance + radius)]
        found, numbers = FacetSet(corners[own]).nearest(points[rows])
        away = np.linalg.norm(found - points[rows], axis=1)
        nearer = (away <= distance) & (away < best[rows])
        rows = rows[nearer]
        places[rows], facets[rows], best[rows] = found[nearer], own[numbers[nearer]], away[nearer]
    return places, facets


def _near(points: Array, others: Array, distance: float) -> NDArray[np.int64]:
    """Rows of the points (n, d) so near to one of the others (k, d)."""
    return np.flatnonzero(np.isfinite(cKDTree(others).query(points, distance_upper_bound=distance)[0]))


def _by_size(corners: Array) -> Iterator[tuple[NDArray[np.int64], float]]:
    """Rows of the facets (f, w, d) by octaves of their radius, and the largest radius of each octave."""
    if not len(corners):
        return
    radius = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    octave = np.floor(np.log2(np.maximum(radius, np.finfo(np.float64).tiny)))
    for number in np.unique(octave):
        rows = np.flatnonzero(octave == number)
        yield rows, float(radius[rows].max())
