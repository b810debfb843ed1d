"""The moving bodies that are clamped at fixed patches, and a bending of each that keeps the clamped nodes at rest."""

import math
from collections.abc import Sequence

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers

from mesh_motion_server.cases.case import Bending
from mesh_motion_server.files import MeshFile


def bodies(mesh: MeshFile, moving: Sequence[str]) -> list[list[str]]:
    """The moving patches, grouped by shared nodes."""
    found: list[list[str]] = []
    for name in moving:
        joined = [body for body in found if any(len(_shared(mesh, name, other)) for other in body)]
        found = [body for body in found if body not in joined] + [[*(part for body in joined for part in body), name]]
    return found


def clamped_bending(
    mesh: MeshFile, body: Sequence[str], fixed: Sequence[str], share: float, normal: Floats | None = None
) -> Bending | None:
    """A bending that moves the body's farthest nodes by about ``share`` of its length; None if it is not clamped, or
    lies across its plane.

    The bending is about the ``normal`` (3,) of a plane, if one is given; else towards the body's thinnest side. A body
    that reaches less than half its extent past its clamped nodes is taken as clamped at both ends.
    """
    nodes = np.unique(np.concatenate([mesh.patches[name] for name in body]))
    shared = [_shared(mesh, name, other) for name in body for other in fixed]
    clamped = np.unique(np.concatenate([*shared, np.empty(0, dtype=np.int64)]))
    points, held = mesh.points[nodes], mesh.points[clamped]
    if not len(held) or mesh.dimension == 1 or not np.ptp(points, axis=0).any():
        return None
    origin = held.mean(axis=0)
    along = _in_plane(points.mean(axis=0) - origin, normal)
    past = float(((points - origin) @ along).max() - ((held - origin) @ along).max())
    both = past < 0.5 * float(np.ptp(points, axis=0).max())
    if both:
        along = _in_plane(np.linalg.svd(held - origin, full_matrices=False)[2][0], normal)
    if not along.any():
        return None
    begin, end = _ends((held - origin) @ along, (points - origin) @ along, both=both)
    slope = math.atan(math.pi * share) if both else 2 * share
    axis = None if mesh.dimension < 3 else normal if normal is not None else _axis(points - origin, along)
    return Bending(
        rotation=float(f"{math.degrees(slope):.2g}"),
        clamp=(origin + begin * along).tolist(),
        tip=(origin + end * along).tolist(),
        axis=None if axis is None else axis.tolist(),
        both_ends=both,
    )


def _in_plane(along: Floats, normal: Floats | None) -> Floats:
    """(d,) the unit vector of ``along`` in the plane with this normal; 0 if it is mostly across the plane."""
    inside = along if normal is None else along - (along @ normal) * normal
    length = float(np.linalg.norm(inside))
    return inside / length if length > 0.5 * float(np.linalg.norm(along)) else np.zeros(len(along))


def _shared(mesh: MeshFile, one: str, other: str) -> Integers:
    return np.intersect1d(mesh.patches[one], mesh.patches[other])


def _ends(held: Floats, places: Floats, *, both: bool) -> tuple[float, float]:
    """The free part of the body: beyond the clamped nodes, or between the clamped nodes of both ends."""
    if not both:
        return float(held.max()), float(places.max())
    middle = (held.min() + held.max()) / 2
    begin, end = float(held[held < middle].max(initial=held.min())), float(held[held >= middle].min())
    is_all_round = end - begin < (held.max() - held.min()) / 2
    return (float(held.min()), float(held.max())) if is_all_round else (begin, end)


def _axis(points: Floats, along: Floats) -> Floats:
    """The axis across the body about which the body bends to its thinnest side."""
    aside = points - np.outer(points @ along, along)
    across = np.linalg.svd(aside - aside.mean(axis=0), full_matrices=False)[2][0]  # the widest direction
    across = across - (across @ along) * along
    return np.asarray(np.round(np.cross(along, np.cross(across, along)), 12))
