"""Checks of the points that an interpolation starts from: shape, finite, distinct."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.arrays import Floats

__all__ = ["checked_control_points"]

#: Points closer than this share of their extent count as one point: the interpolation matrix would be singular.
_SAME_POINT = 1e-13


def checked_control_points(control_points: ArrayLike) -> Floats:
    """A contiguous copy of (nc, d) control points, d = 1, 2 or 3.

    Raises
    ------
    InvalidInput
        On another shape, no point at all, a coordinate that is not finite, or two points that coincide.
    """
    points = np.array(control_points, dtype=np.float64, order="C")
    if points.ndim != 2 or points.shape[1] not in {1, 2, 3}:
        raise InvalidInput(
            f"expected control points of shape (nc, d) with d = 1, 2 or 3, got {points.shape}",
            code="INVALID_ARGUMENT.SHAPE",
        )
    if not len(points):
        raise InvalidInput(
            "expected at least one control point, got none", hint="give a patch the role moving or fixed"
        )
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if bad.size:
        raise InvalidInput(
            f"control point {bad[0]} is not finite: {points[bad[0]].tolist()}",
            code="INVALID_ARGUMENT.NONFINITE",
            details={"control_point": int(bad[0])},
        )
    _refuse_coincident(points)
    return points


def _refuse_coincident(points: Floats) -> None:
    """Raise if two points coincide."""
    if len(points) < 2:
        return
    extent = float(np.max(points.max(axis=0) - points.min(axis=0)))
    distances, neighbours = cKDTree(points).query(points, k=2)
    same = np.flatnonzero(distances[:, 1] <= _SAME_POINT * extent)
    if not same.size:
        return
    first = int(same[0])
    second = int(next(j for j in (*neighbours[first], *same) if j != first))
    raise InvalidInput(
        f"control points {first} and {second} coincide at {points[first].tolist()}",
        hint="merge duplicated boundary nodes, or leave one of the two out",
        details={"control_points": [first, second]},
    )
