"""Checks that the control points of an interpolation are distinct."""

import numpy as np
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.mesh.neighbours import local_spacing

#: Points closer than this share of their extent count as one point: the interpolation matrix would be singular.
_SAME_POINT = 1e-13


def checked_control_points(control_points: ArrayLike, spacing: Floats | None = None) -> Floats:
    """Return a contiguous copy of (nc, d) control points, d = 1, 2 or 3.

    Raises InvalidInput on two points that coincide.

    Parameters
    ----------
    spacing : (nc,) array, optional
        Result of :func:`~mesh_motion_numerics.mesh.neighbours.local_spacing`, if it is known.
    """
    points = np.array(control_points, dtype=np.float64, order="C")
    if len(points) < 2:
        return points
    extent = float(np.max(points.max(axis=0) - points.min(axis=0)))
    same = np.flatnonzero((local_spacing(points) if spacing is None else spacing) <= _SAME_POINT * extent)
    if same.size:
        first = int(same[0])
        second = int(next(j for j in (*cKDTree(points).query(points[first], k=2)[1], *same) if j != first))
        raise InvalidInput(
            f"control points {first} and {second} coincide at {points[first].tolist()}",
            hint="merge duplicated boundary nodes, or leave one of the two out",
            details={"control_points": [first, second]},
        )
    return points
