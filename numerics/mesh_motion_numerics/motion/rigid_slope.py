"""The derivative of the rigid motion of a mesh without fixed nodes: see :meth:`.StandardMotion.carry`.

Every such motion is ``x → c + P t + R (x − c)``, with a shift t and a rotation R that are fitted to the control nodes:
any rotation, one about the axis of a periodic sector or of all walls, or none; P keeps the shift in the plane walls.
"""

from __future__ import annotations

import numpy as np
from mesh_motion_protocol.errors import QualityRefused

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.decomposition import nearest_rotation_slope
from mesh_motion_numerics.mesh.paths import RigidMotion
from mesh_motion_numerics.mesh.rigid_transforms import cross_matrix
from mesh_motion_numerics.mesh.sliding import ACROSS, SlidingSurfaces
from mesh_motion_numerics.motion.standard_motion import StandardMotion

#: Singular values and eigenvalues below this share of the largest are 0.
_ROUNDING = 1e-9


class RigidSlope:
    """The derivative of the rigid motion of control nodes, which carries them and other places.

    Parameters
    ----------
    arms, far : (c, d), (p, d) arrays, mesh length unit
        Vectors from the centre to the control nodes and to the places, at rest.
    along : (d, d) array
        P.
    turn : (d, d, d, d) array
        ``[a, b, c, e] = ∂R_ab/∂B_ce`` with ``B = Σ y xᵀ`` of the control nodes' goals y and arms x.
    """

    def __init__(self, arms: Floats, far: Floats, along: Floats, turn: Floats) -> None:
        self._arms, self._far, self._along, self._turn = arms, far, along, turn

    def apply(self, values: Floats) -> tuple[Floats, Floats]:
        """Velocities of the carried control nodes (c, d) and places (p, d), for those (c, d) of the control nodes."""
        shift = self._along @ values.mean(axis=0)
        turn = np.einsum("abce,ce->ab", self._turn, values.T @ self._arms)
        return shift + self._arms @ turn.T, shift + self._far @ turn.T

    def transpose(self, carried: Floats, places: Floats) -> Floats:
        """(c, d) weights of the control nodes for (c, d) of the carried ones and (p, d) of the places."""
        shift = (carried.sum(axis=0) + places.sum(axis=0)) @ self._along
        turn = carried.T @ self._arms + places.T @ self._far
        return np.asarray(shift / len(self._arms) + self._arms @ np.einsum("abce,ab->ec", self._turn, turn))


def rigid_slope(motion: StandardMotion, controls: Integers, goal: Floats, places: Floats) -> RigidSlope | None:
    """The derivative for control nodes (c,) from the reference mesh to ``goal`` (n, d); None without a rigid part.

    Raises QualityRefused at rest, if the direction of the motion decides whether the mesh is carried along.
    """
    origin, there = motion.reference[controls], goal[controls]
    at_rest = np.array_equal(origin, there)
    fitted = motion.fitted(origin, there)
    if fitted is None or not _carries(motion, origin, there, at_rest=at_rest):
        return None
    arms, rows, d = origin - fitted.centre, there - fitted.centre, origin.shape[1]
    along, turn = np.eye(d), np.zeros((d, d, d, d))
    axis = None if motion.sliding is None else motion.sliding.axis
    if axis is not None:
        along, turn = np.zeros((d, d)), _about_axis(fitted, arms, rows)
    elif motion.periodic is None:
        spread = (there - there.mean(axis=0)).T @ arms
        turn = nearest_rotation_slope(spread[None])[0]
    elif motion.periodic.turns:
        along = np.outer(fitted.axis, fitted.axis)[:d, :d]
        turn = _about_axis(fitted, arms, rows)
    if motion.sliding is not None:
        if motion.sliding.planes is not None:
            along = motion.sliding.planes.tangents(origin[:1], origin[:1])[0] @ along
        if at_rest and not _carried_at_rest(motion.sliding, along, turn, fitted.centre):
            return None
    return RigidSlope(arms, places - fitted.centre, along, turn)


def _carries(motion: StandardMotion, origin: Floats, there: Floats, *, at_rest: bool) -> bool:
    """Whether the motion from origin to goal (c, d) has a rigid part; at rest, whether the periods admit one."""
    if not at_rest:
        return motion.carry(motion.reference, origin, there) is not None
    periods = () if motion.periodic is None else motion.periodic.generators
    return all(motion.fitted(origin, period(origin)) is not None for period in periods if period.turns)


def _about_axis(fitted: RigidMotion, arms: Floats, goals: Floats) -> Floats:
    """(d, d, d, d) derivative of the rotation about an axis, whose angle is atan2(Σ a · (x × y), Σ x · y)."""
    d = arms.shape[1]
    cross = cross_matrix(fitted.axis)[:d, :d]
    across = np.eye(d) - np.outer(fitted.axis, fitted.axis)[:d, :d]
    spread = goals.T @ arms
    sine, cosine = float(np.sum(cross * spread)), float(np.sum(across * spread))
    by_spread = (cosine * cross - sine * across) / (sine**2 + cosine**2)
    return np.multiply.outer(cross @ fitted.rotation, by_spread)


def _carried_at_rest(sliding: SlidingSurfaces, along: Floats, turn: Floats, centre: Floats) -> bool:
    """Whether the walls admit every small rigid motion, or none that moves the mesh.

    Raises QualityRefused if they admit only some of them.
    """
    d, places = len(along), sliding.reference
    spins = _range(turn.reshape(d * d, d * d)).reshape(-1, d, d)
    moved = [np.broadcast_to(shift, places.shape) for shift in _range(along)]
    moved += [(places - centre) @ spin.T for spin in spins]
    if not moved:
        return False
    fields = np.stack(moved, axis=-1)  # (s, d, m)
    off = fields - sliding.slope(places) @ fields
    forms = np.swapaxes(off, 1, 2) @ off - ACROSS**2 * (np.swapaxes(fields, 1, 2) @ fields)
    scale = _ROUNDING * np.abs(np.swapaxes(fields, 1, 2) @ fields).max()
    if np.linalg.eigvalsh(forms).max() <= scale:
        return True
    if np.linalg.eigvalsh(forms.sum(axis=0)).min() > scale:
        return False
    raise QualityRefused(
        "at rest it depends on the direction whether the whole mesh is carried along its walls: "
        "the motion has no derivative here",
        code="FAILED_PRECONDITION",
        hint="request it after a displacement, or give a patch the role fixed",
    )


def _range(matrix: Floats) -> Floats:
    """(r, k) orthonormal directions that span the range of a matrix (k, k)."""
    left, sizes, _ = np.linalg.svd(matrix)
    return np.asarray(left.T[sizes > _ROUNDING * sizes.max()])
