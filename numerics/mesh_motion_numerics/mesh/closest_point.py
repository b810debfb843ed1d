"""The closest point of a set of segments or triangles.

A k-d tree of the facets' centroids limits the search: the closest facet's centroid is no farther away than the nearest
centroid plus the largest facet's radius. Among those candidates the closest point is exact; of equally near facets the
lowest is taken.
"""

from collections.abc import Iterator

import mesh_motion_kernels as kernels
import numpy as np
from scipy.spatial import cKDTree

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.points import padded


class FacetSet:
    """Segments (2D, or curves in 3D) or triangles.

    Parameters
    ----------
    corners : (f, 2 or 3, d) array, mesh length unit
        f > 0.
    """

    def __init__(self, corners: Floats) -> None:
        facets, width, self._dimension = corners.shape
        self._corners = padded(corners.reshape(-1, self._dimension)).reshape(facets, width, 3)
        centroids = self._corners.mean(axis=1)
        away = self._corners - centroids[:, None]
        self._reach = float(np.sqrt(np.max(np.sum(away * away, axis=2))))
        self._tree = cKDTree(centroids)

    def closest(self, points: Floats) -> Floats:
        """(n, d) points of the facets nearest to (n, d) points."""
        return self.nearest(points)[0]

    def nearest(self, points: Floats) -> tuple[Floats, Integers]:
        """(n, d) points of the facets nearest to (n, d) points, and the row (n,) of the facet of each."""
        places, facets, _ = self._searched(points, self._reach)
        return np.ascontiguousarray(places[:, : self._dimension]), facets

    def smooth(self, points: Floats, directions: Floats) -> Floats:
        """(n, d) points of the facets that change continuously with the (n, d) points, while the nearest ones jump.

        Each is the point from which a normal that is interpolated between a facet's corners leads to the given point
        (Phong projection: D. Panozzo et al., Weighted averages on surfaces, ACM Trans. Graph. 32(4), 2013); the nearest
        point if there is no such normal.

        Parameters
        ----------
        directions : (f, 2 or 3, d) array
            At each corner: a segment's tangent, in the segment's direction; a triangle's normal. They may have any
            length.
        """
        # the facet of the normal shares a corner with the nearest facet, or nearly so
        out, facets, lists = self._searched(points, 3.0 * self._reach)
        if len(points):
            along = padded(directions.reshape(-1, self._dimension)).reshape(self._corners.shape)
            kernels.smooth_points(padded(points), self._corners, along, facets, *lists, out)
        return np.ascontiguousarray(out[:, : self._dimension])

    def containing(self, places: Floats) -> tuple[Integers, Integers]:
        """Pairs (q,) of a row of the places (n, d), which are on facets, and a facet that may contain it."""
        lists = self._tree.query_ball_point(padded(places), self._reach * (1.0 + 1e-9), return_sorted=True)
        rows = np.repeat(np.arange(len(places)), [len(facets) for facets in lists])
        return rows, np.concatenate([np.empty(0, dtype=np.int64), *lists]).astype(np.int64)

    def _searched(self, points: Floats, reach: float) -> tuple[Floats, Integers, tuple[Integers, Integers]]:
        """The nearest points (n, 3), their facets (n,), and the facets around them as the kernels' lists."""
        places, facets = padded(points), np.zeros(len(points), dtype=np.int64)
        out, starts = places.copy(), np.zeros(len(points) + 1, dtype=np.int64)
        if not len(points):
            return out, facets, (starts, facets)
        distance = (self._tree.query(places)[0] + reach) * (1.0 + 1e-12)
        lists = self._tree.query_ball_point(places, distance, return_sorted=True)
        np.cumsum([len(candidates) for candidates in lists], out=starts[1:])
        candidates = np.concatenate(lists).astype(np.int64)
        kernels.closest_points(places, self._corners, starts, candidates, out, facets)
        return out, facets, (starts, candidates)


def nearest_within(corners: Floats, points: Floats, distance: float) -> tuple[Floats, Integers]:
    """The nearest facets within a distance, for facets of very different sizes.

    The search radius grows with the largest facet: with facets of a far field it would cover the whole mesh. So facets
    are searched by octaves of their radius.

    Parameters
    ----------
    corners : (f, 2 or 3, d) array, mesh length unit
        f may be 0.
    points : (n, d) array, mesh length unit
    distance : float, mesh length unit

    Returns
    -------
    (n, d) array, (n,) int64 array
        The nearest points of facets, and the facets' rows; NaN and −1 if none is near.
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


def are_within(corners: Floats, points: Floats, distance: float) -> Marks:
    """(n,) whether points (n, d) are within a distance of facets (f, 2 or 3, d) of any sizes."""
    near, (facets, width, d) = np.zeros(len(points), dtype=bool), corners.shape
    spatial = padded(corners.reshape(-1, d)).reshape(facets, width, 3)
    kernels.points_near_facets(padded(points), spatial, distance, near)
    return near


def _near(points: Floats, others: Floats, distance: float) -> Integers:
    """Rows of the points (n, d) within ``distance`` of one of the others (k, d)."""
    return np.flatnonzero(np.isfinite(cKDTree(others).query(points, distance_upper_bound=distance)[0]))


def _by_size(corners: Floats) -> Iterator[tuple[Integers, float]]:
    """Rows of the facets (f, w, d) by octaves of their radius, and the largest radius of each octave."""
    if not len(corners):
        return
    radius = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    octave = np.floor(np.log2(np.maximum(radius, np.finfo(np.float64).tiny)))
    for number in np.unique(octave):
        rows = np.flatnonzero(octave == number)
        yield rows, float(radius[rows].max())
