"""Surfaces of revolution, and curves around an axis: every rotation about the axis maps them onto themselves."""

from __future__ import annotations

import numpy as np

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.mesh.rigid_transforms import Transform

#: The facets may leave such a surface by this share of a rotation (root mean square) about its axis.
OFF = 0.07


def about(turn: Transform, places: Floats) -> Floats:
    """(m, d) velocities of places (m, d) in the rotation about the axis of a ``turn``, by one radian."""
    return np.asarray(across(turn, places) @ _cross(turn).T)


def across(turn: Transform, places: Floats) -> Floats:
    """(m, d) vectors from the axis of a ``turn`` to places (m, d), across the axis."""
    centre, flat = _axis(turn)
    return np.asarray((places - centre) @ flat.T)


def _axis(turn: Transform) -> tuple[Floats, Floats]:
    """A point (d,) on the axis of a ``turn``, and the projection (d, d) onto the plane across it."""
    gap = np.eye(len(turn.shift)) - turn.rotation
    inverse = np.linalg.pinv(gap, rcond=1e-9)
    return inverse @ turn.shift, inverse @ gap


def _cross(turn: Transform) -> Floats:
    """(d, d) the cross product with the unit vector of a turn's axis, that is a quarter turn across it."""
    skew = turn.rotation - turn.rotation.T
    return np.asarray(skew / np.sqrt(0.5 * np.sum(skew * skew)))


def turns_onto_itself(corners: Floats, turn: Transform) -> bool:
    """Whether segments (f, 2, d) or triangles (f, 3, d) are parts of one surface or curve about the axis of a turn."""
    if abs(np.sin(turn.angle)) < 1e-9:
        return False  # half a turn says no direction
    edges, speeds = corners[:, 1:] - corners[:, :1], about(turn, corners.mean(axis=1))
    if corners.shape[1] == 2:
        along = edges[:, 0] / np.linalg.norm(edges[:, 0], axis=1)[:, None]
        off, sizes = speeds - np.sum(speeds * along, axis=1)[:, None] * along, np.linalg.norm(edges[:, 0], axis=1)
    else:
        normals = np.cross(edges[:, 0], edges[:, 1])
        sizes = np.linalg.norm(normals, axis=1)
        off = np.sum(speeds * normals, axis=1)[:, None] / sizes[:, None]
    return bool(np.sum(sizes * np.sum(off * off, axis=1)) <= OFF**2 * np.sum(sizes * np.sum(speeds * speeds, axis=1)))


def turned_to(places: Floats, reference: Floats, turn: Transform) -> tuple[Floats, Floats, Floats]:
    """The places (m, d) turned about the axis of a ``turn`` to the angle of their reference (m, d).

    Returns
    -------
    (m, d), (m, d, d), (m, d) arrays
        The turned places, and R, s of the inverse: place = R turned + s.
    """
    d, cross = places.shape[1], _cross(turn)
    now, rest = across(turn, places), across(turn, reference)
    angle = np.arctan2(np.sum(now * (rest @ cross.T), axis=1), np.sum(now * rest, axis=1))[:, None, None]
    rotations = np.eye(d) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
    centre, _ = _axis(turn)
    shifts = centre - rotations @ centre
    return np.einsum("mij,mi->mj", rotations, places - shifts), rotations, shifts
