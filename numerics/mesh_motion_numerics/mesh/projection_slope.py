"""The derivative of the place on facets from which an interpolated normal leads to a point (:meth:`.FacetSet.smooth`).

A place q(u, v) of a triangle with the normal n(u, v) satisfies ``p = q + h n``, so ::

    dp = (q_u + h n_u) du + (q_v + h n_v) dv + n dh,      dq = q_u du + q_v dv

and on a segment with the direction t(u), where ``(p − q) · t = 0``, the derivative is
``dq = q_u (t · dp) / (q_u · t − (p − q) · t_u)``.
"""

from __future__ import annotations

import numpy as np

from mesh_motion_numerics.arrays import Floats, Marks

#: A normal leads to a point if it misses it by less than this share of the facet's first edge.
_MISS = 1e-8
#: A place is on a side of its facet if a barycentric coordinate is less than this.
_ON_SIDE = 1e-9


def smooth_slopes(away: Floats, corners: Floats, directions: Floats, weights: Floats) -> tuple[Marks, Floats]:
    """Whether a normal leads from each place to its point, and the derivatives (q, d, d) by the points.

    If no normal does, the place is the nearest one: on a facet, on its side, or at a corner, which does not move.

    Parameters
    ----------
    away : (q, d) array, mesh length unit
        Vector from the place to the point.
    corners, directions : (q, 2 or 3, d) arrays
        Corners of the place's facet, mesh length unit, and its normals there, or a segment's tangents.
    weights : (q, 2 or 3) array
        Barycentric coordinates of the place.
    """
    edges, turns = corners[:, 1:] - corners[:, :1], directions[:, 1:] - directions[:, :1]
    least = _MISS * np.linalg.norm(edges[:, 0], axis=1)
    at = np.einsum("qk,qkd->qd", weights, directions)
    if corners.shape[1] == 2:
        edge, turn = edges[:, 0], turns[:, 0]
        rate = np.einsum("qd,qd->q", edge, at) - np.einsum("qd,qd->q", away, turn)
        smooth = np.abs(np.einsum("qd,qd->q", away, at)) <= least * np.linalg.norm(at, axis=1)
        smooth &= rate > 0.0
        slopes = edge[:, :, None] * at[:, None, :] / np.where(smooth, rate, 1.0)[:, None, None]
    else:
        height = np.einsum("qd,qd->q", away, at) / np.einsum("qd,qd->q", at, at)
        smooth = np.linalg.norm(away - height[:, None] * at, axis=1) <= least
        matrix = np.concatenate([edges + height[:, None, None] * turns, at[:, None]], axis=1)  # rows: by u, v, h
        smooth &= np.abs(np.linalg.det(matrix)) > 0.0
        inverse = np.linalg.inv(np.where(smooth[:, None, None], matrix, np.eye(3)))
        slopes = np.einsum("qka,qck->qac", edges, inverse[:, :, :2])
    slopes[~smooth] = _nearest_slopes(corners[~smooth], weights[~smooth])
    return smooth, slopes


def facet_angles(corners: Floats, weights: Floats) -> Floats:
    """(q,) radians: the angle of facets (q, 2 or 3, d) at their places, π if a place is at no corner."""
    angles = np.full(len(corners), np.pi)
    if corners.shape[1] == 3:
        rows = np.flatnonzero(np.count_nonzero(weights > _ON_SIDE, axis=1) == 1)
        corner = np.argmax(weights[rows], axis=1)
        here = corners[rows, corner]
        one, other = (corners[rows, (corner + k) % 3] - here for k in (1, 2))
        cosine = np.einsum("qd,qd->q", one, other) / np.linalg.norm(one, axis=1) / np.linalg.norm(other, axis=1)
        angles[rows] = np.arccos(np.clip(cosine, -1.0, 1.0))
    return angles


def _nearest_slopes(corners: Floats, weights: Floats) -> Floats:
    """(q, d, d) projectors onto the plane, the side or the corner of the facets at the places."""
    within = weights > _ON_SIDE
    first = np.take_along_axis(corners, np.argmax(within, axis=1)[:, None, None], axis=1)
    spans = np.where(within[:, :, None], corners - first, 0.0)
    return np.asarray(np.linalg.pinv(spans) @ spans)
