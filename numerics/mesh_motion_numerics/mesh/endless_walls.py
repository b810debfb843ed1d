"""Walls without an end, such as a circle or a box with rounded corners, and the axis about which walls can turn.

Such walls have no end that limits how far they follow a body: they would go with it, and all of their nodes would be
pulled to one half of the wall. So they stay, or turn with the body about the axis of all walls if no node is fixed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mesh_motion_numerics.arrays import Floats, Marks
from mesh_motion_numerics.mesh.neighbours import connected
from mesh_motion_numerics.mesh.revolution import OFF
from mesh_motion_numerics.mesh.rigid_transforms import Transform
from mesh_motion_numerics.mesh.smooth_pieces import Piece, as_simplices

#: A screw is a rotation if it advances by less than this share of the walls' extent in each radian.
_ADVANCE = 1e-3


def endless_nodes(pieces: Sequence[Piece], sliding: Marks) -> Marks:
    """(n,) nodes of curved walls whose connected pieces have ``sliding`` (n,) nodes only."""
    pieces, found = [piece for piece in pieces if piece.normal is None], np.zeros(len(sliding), dtype=bool)
    if not pieces:
        return found
    nodes = np.concatenate([piece.nodes for piece in pieces])
    owners = np.repeat(np.arange(len(pieces)), [len(piece.nodes) for piece in pieces])
    wall = connected(len(pieces) + len(sliding), owners, len(pieces) + nodes)[len(pieces) :]
    ended = np.isin(wall, wall[nodes[~sliding[nodes]]])
    found[nodes] = ~ended[nodes]
    return found


def axis_of(points: Floats, pieces: Sequence[Piece]) -> tuple[Transform | None, bool]:
    """A rotation about the only axis about which all pieces turn onto themselves, and whether any rotation does this.

    At places x with normals n, a motion with velocity v + w × x keeps the walls if n · (v + w × x) = 0. So the axis is
    that of the null space of a small matrix, as of every surface of revolution (H. Pottmann, J. Wallner,
    *Computational Line Geometry*, Springer 2001, §4.1). It has dimension 3 for a sphere.
    """
    corners = points[np.concatenate([as_simplices(piece.facets) for piece in pieces])]
    d, middle = points.shape[1], corners.mean(axis=(0, 1))
    scale = float(np.abs(corners - middle).max())
    places = (corners.mean(axis=1) - middle) / scale
    edges = corners[:, 1:] - corners[:, :1]
    normals = edges[:, 0] @ [[0.0, -1.0], [1.0, 0.0]] if d == 2 else np.cross(edges[:, 0], edges[:, 1])
    sizes = np.linalg.norm(normals, axis=1)
    fields = _rigid_fields(places)
    across = np.einsum("fd,fdk->fk", normals / sizes[:, None], fields)
    off, all_ = across.T @ (sizes[:, None] * across), np.einsum("f,fdk,fdl->kl", sizes, fields, fields)
    root = np.linalg.inv(np.linalg.cholesky(all_))
    shares, motions = np.linalg.eigh(root @ off @ root.T)
    kept = np.count_nonzero(shares <= OFF**2)
    if kept != 1:
        return None, kept == 3
    motion = root.T @ motions[:, 0]
    shift, spin = motion[:d], motion[d:]
    rate = float(np.linalg.norm(spin))
    if d == 2:
        centre = np.array([-shift[1], shift[0]]) / spin[0] if rate else None
        return (None if centre is None else Transform.about(middle + scale * centre, 1.0)), False
    if abs(float(shift @ spin)) > _ADVANCE * rate**2:
        return None, False
    return Transform.about(middle + scale * np.cross(spin, shift) / rate**2, 1.0, spin / rate), False


def _rigid_fields(places: Floats) -> Floats:
    """(f, d, 3 or 6) velocities of the unit shifts and of the rotations about the coordinate axes at places (f, d)."""
    f, d = places.shape
    shifts = np.broadcast_to(np.eye(d), (f, d, d))
    if d == 2:
        return np.concatenate([shifts, np.stack([-places[:, 1], places[:, 0]], axis=1)[:, :, None]], axis=2)
    turns = [np.cross(axis, places) for axis in np.eye(3)]
    return np.concatenate([shifts, np.stack(turns, axis=2)], axis=2)
