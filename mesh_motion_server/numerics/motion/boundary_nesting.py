"""Detects a part of the boundary that has left the part around it, or entered another one: no valid mesh exists then.

A body that has moved wholly through a wall crosses nothing at its targets. How often a closed part of the boundary goes
round a node of another part tells on which side the node is: its winding number, the sum of the angles of the part's
segments in 2D, of the solid angles of its triangles in 3D, as a share of the full angle. No valid motion changes it.

References
----------
A. Van Oosterom, J. Strackee, "The solid angle of a plane triangle", IEEE Trans. Biomed. Eng. 30 (1983) 125–126.
"""

from collections.abc import Mapping

import numpy as np

from mesh_motion_server.numerics.arrays import Floats, Integers, Marks
from mesh_motion_server.numerics.mesh.boundary_orientation import closed_parts, of_one_width

__all__ = ["misplaced_place"]


#: Nodes that are tested, spread over the moving ones: what has left is found by any of its nodes that are outside.
_PROBES = 16
#: A node on the part itself has no side: its winding number is not near an integer.
_ON_IT = 0.1


def misplaced_place(
    facets: Mapping[str, Integers], prescribed: Marks, moving: Integers, reference: Floats, points: Floats
) -> Floats | None:
    """The first place (d,) of a moving node on the wrong side of another part of the boundary, None if there is none.

    Parameters
    ----------
    facets : dict of (f, k) int64 arrays
        The whole boundary, pointing outwards, by type.
    prescribed : (n,) bool array
        Nodes with prescribed positions; a part with any other node is not tested.
    moving : (k,) int64 array
        Moving nodes.
    reference, points : (n, d) arrays, mesh length unit
        Before and after the motion.
    """
    if reference.shape[1] == 1 or not facets:
        return None
    rows = of_one_width(facets)
    parts, whole = closed_parts(rows, prescribed, len(points))
    chosen = moving[np.unique(np.linspace(0, len(moving) - 1, _PROBES).astype(np.int64))]
    for part in np.flatnonzero(whole):
        own = rows[parts == part]
        others = chosen[~np.isin(chosen, own)]
        before, after = (_windings(places[others], places, own) for places in (reference, points))
        sure = np.maximum(*(np.abs(each - np.round(each)) for each in (before, after))) < _ON_IT
        wrong = others[sure & (np.round(before) != np.round(after))]
        if len(wrong):
            place: Floats = points[wrong[0]]
            return place
    return None


def _windings(probes: Floats, points: Floats, rows: Integers) -> Floats:
    """(p,) how often closed facets (f, w) of a mesh ``points`` (n, d) wind round each of the probes (p, d)."""
    if probes.shape[1] == 2:
        a, b = (points[rows[:, corner]] - probes[:, None] for corner in (0, 1))
        angles = np.arctan2(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], np.sum(a * b, axis=2))
        return np.asarray(angles.sum(axis=1) / (2.0 * np.pi))
    quads = rows[rows[:, 3] >= 0]
    triangles = np.concatenate([rows[:, :3], quads[:, [0, 2, 3]]])
    a, b, c = (points[triangles[:, corner]] - probes[:, None] for corner in (0, 1, 2))
    la, lb, lc = (np.linalg.norm(edge, axis=2) for edge in (a, b, c))
    volume = np.sum(a * np.cross(b, c), axis=2)
    share = la * lb * lc + np.sum(a * b, axis=2) * lc + np.sum(b * c, axis=2) * la + np.sum(c * a, axis=2) * lb
    return np.asarray(2.0 * np.arctan2(volume, share).sum(axis=1) / (4.0 * np.pi))
