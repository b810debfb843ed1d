"""The rigid part of a boundary's motion, and paths that turn with it.

A displacement scaled by t < 1 shrinks a rotating body (to a point, half way through 180°). So a large step is divided
along the motion of constant twist that its best rigid fit defines: a screw in 3D, an arc about the pole in 2D, a
straight line without rotation. The non-rigid part grows linearly in the frame of the turning body. The end is the given
displacement, bitwise.

References
----------
W. Kabsch, "A solution for the best rotation to relate two sets of vectors", Acta Cryst. A32 (1976) 922–923. R. M.
Murray, Z. Li, S. S. Sastry, *A Mathematical Introduction to Robotic Manipulation*, CRC 1994, §2.3 (twists).
"""

from dataclasses import dataclass

import numpy as np

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.mesh.points import padded
from mesh_motion_numerics.mesh.rigid_transforms import Transform, cross_matrix

#: Directions with less than this share of the points' spread are ignored: their rotation is not determined.
_DEGENERATE = 1e-12
#: Rotations closer than this to 180° count as 180° in the conventional sense; the data do not determine the sense.
_HALF_TURN = 1e-12


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """``x → centre + translation + R (x − centre)``."""

    #: centre, translation: (d,), mesh length unit
    centre: Floats
    translation: Floats
    angle: float  # radians. In [0, π] in 3D, in (−π, π] in 2D (anticlockwise positive), 0 in 1D
    axis: Floats  # (3,). Unit vector; (0, 0, 1) in 1D and 2D

    @property
    def rotation(self) -> Floats:
        """(d, d) matrix R."""
        return _rotation(self.axis, self.angle, self.centre.size)

    def apply(self, points: Floats, fraction: float = 1.0) -> Floats:
        """(n, d) points carried along the motion of constant twist, up to a fraction of it."""
        turn = _rotation(self.axis, fraction * self.angle, self.centre.size)
        relative = points - self.centre
        carried = np.tile(self.centre + self._path(fraction), (len(points), 1))
        for column, direction in zip(relative.T, turn.T, strict=True):  # a matrix product's sums depend on its blocking
            carried += column[:, None] * direction
        return carried

    def _path(self, fraction: float) -> Floats:
        """Displacement of the centre after a fraction: ``∫₀ᵗ R(sθ) ds (∫₀¹ R(sθ) ds)⁻¹ translation``."""
        if self.angle == 0.0 or fraction in {0.0, 1.0}:
            return fraction * self.translation
        d = self.centre.size
        whole = _mean_rotation(self.axis, self.angle, d)
        part = fraction * _mean_rotation(self.axis, fraction * self.angle, d)
        moved: Floats = part @ np.linalg.solve(whole, self.translation)
        return moved


def fit_rigid_motion(points: Floats, moved: Floats) -> RigidMotion:
    """The rigid motion that takes points closest to their moved positions, in least squares (Kabsch).

    If the points do not determine the motion, a fixed rule decides: no rotation for a single place, the smallest
    rotation for points on a line, anticlockwise (2D) or about the axis with positive largest component (3D) for 180°.

    Parameters
    ----------
    points, moved : (k, d) arrays, mesh length unit
        k > 0.
    """
    centre, goal = points.mean(axis=0), moved.mean(axis=0)
    angle, axis = _fitted_rotation(points - centre, moved - goal)
    return RigidMotion(centre, goal - centre, angle, axis)


def fit_screw(points: Floats, moved: Floats, turn: Transform) -> RigidMotion:
    """The rotation about the axis of a ``turn``, and the shift along it, that take points closest to moved ones.

    Parameters
    ----------
    points, moved : (k, d) arrays, mesh length unit
        k > 0.
    turn : Transform
        A rotation; in 2D about a point.
    """
    d = points.shape[1]
    axis = np.array([0.0, 0.0, 1.0]) if d == 2 else _angle_axis(turn.rotation)[1]
    centre = np.asarray(np.linalg.lstsq(np.eye(d) - turn.rotation, turn.shift)[0], dtype=np.float64)
    x, y = padded(points - centre), padded(moved - centre)
    along = float(np.mean((y - x) @ axis))
    x, y = x - np.outer(x @ axis, axis), y - np.outer(y @ axis, axis)
    scale = float(np.sqrt(np.sum(x * x) * np.sum(y * y)))
    angle = _plane_angle(float(np.sum(x * y)), float(np.sum(np.cross(x, y) @ axis)), scale)
    return RigidMotion(centre, along * axis[:d], angle, axis)


def split_rigid(points: Floats, displacement: Floats) -> tuple[RigidMotion, Floats]:
    """The rigid part of a displacement, and the (k, d) remainder: ``x + u = rigid(x) + remainder``."""
    rigid = fit_rigid_motion(points, points + displacement)
    return rigid, points + displacement - rigid.apply(points)


def substeps(points: Floats, displacement: Floats, count: int) -> Floats:
    """Cumulative displacements along the path from rest to a displacement.

    Parameters
    ----------
    points : (k, d) array, mesh length unit
    displacement : (k, d) array, mesh length unit

    Returns
    -------
    (count, k, d) array
        ``[s]`` after step s + 1; the last is ``displacement``, bitwise.
    """
    out = np.empty((count, *displacement.shape))
    out[-1] = displacement
    if count == 1:
        return out
    rigid, remainder = split_rigid(points, displacement)
    in_body = remainder @ rigid.rotation  # rows times R: Rᵀ applied to each
    for step in range(1, count):
        fraction = step / count
        out[step - 1] = rigid.apply(points + fraction * in_body, fraction) - points
    return out


def _fitted_rotation(x: Floats, y: Floats) -> tuple[float, Floats]:
    """Angle and axis of the best rotation of centred points."""
    d = x.shape[1]
    up = np.array([0.0, 0.0, 1.0])
    scale = float(np.sqrt(np.sum(x * x) * np.sum(y * y)))
    if d == 1 or scale == 0.0 or np.array_equal(x, y):
        return 0.0, up
    if d == 2:
        return _plane_angle(float(np.sum(x * y)), float(np.sum(x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0])), scale), up
    u, sigma, vt = np.linalg.svd(np.einsum("ki,kj->ij", x, y))
    if sigma[0] <= _DEGENERATE * scale:
        return 0.0, up
    if sigma[1] <= _DEGENERATE * sigma[0]:
        return _smallest_rotation(u[:, 0], vt[0])
    proper = np.diag([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    return _angle_axis(vt.T @ proper @ u.T)


def _plane_angle(cosine: float, sine: float, scale: float) -> float:
    """Angle of a rotation in the plane from unnormalised cosine and sine."""
    if np.hypot(cosine, sine) <= _DEGENERATE * scale:
        return 0.0
    if cosine < 0.0 and abs(sine) <= -_HALF_TURN * cosine:
        return float(np.pi)
    return float(np.arctan2(sine, cosine))


def _smallest_rotation(a: Floats, b: Floats) -> tuple[float, Floats]:
    """Angle and axis of the least rotation from unit vector a to unit vector b."""
    normal = np.cross(a, b)
    sine = float(np.linalg.norm(normal))
    if sine <= _HALF_TURN:
        across = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
        return (0.0 if float(a @ b) > 0.0 else float(np.pi)), _upward(across / np.linalg.norm(across))
    return float(np.arctan2(sine, float(a @ b))), normal / sine


def _angle_axis(r: Floats) -> tuple[float, Floats]:
    """Angle in [0, π] and axis of a rotation matrix."""
    skew = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / 2.0
    sine, cosine = float(np.linalg.norm(skew)), (float(np.trace(r)) - 1.0) / 2.0
    angle = float(np.arctan2(sine, cosine))
    if sine > 1e-3:
        return angle, skew / sine
    if cosine > 0.0:
        return (angle, skew / sine) if sine > 0.0 else (0.0, np.array([0.0, 0.0, 1.0]))
    # near 180° the skew part is inaccurate: R + Rᵀ = 2 cos θ I + 2 (1 − cos θ) a aᵀ
    outer = (r + r.T) / 2.0 - cosine * np.eye(3)
    axis = outer[:, int(np.argmax(np.diag(outer)))]
    axis = axis / np.linalg.norm(axis)
    if sine <= _HALF_TURN:
        return float(np.pi), _upward(axis)
    return angle, axis if float(axis @ skew) > 0.0 else -axis


def _upward(axis: Floats) -> Floats:
    """The axis or its opposite, with a positive largest component."""
    upward: Floats = axis * np.sign(axis[int(np.argmax(np.abs(axis)))])
    return upward


def _rotation(axis: Floats, angle: float, d: int) -> Floats:
    """(d, d) rotation matrix, by Rodrigues' formula."""
    if angle == 0.0:
        return np.eye(d)
    k = cross_matrix(axis)
    full: Floats = np.eye(3) + np.sin(angle) * k + 2.0 * np.sin(angle / 2.0) ** 2 * (k @ k)
    return full[:d, :d]


def _mean_rotation(axis: Floats, angle: float, d: int) -> Floats:
    """(d, d) matrix ``∫₀¹ R(sθ) ds``; invertible for |θ| < 2π."""
    k = cross_matrix(axis)
    half = np.sinc(angle / (2.0 * np.pi))
    first = half * np.sin(angle / 2.0)  # (1 − cos θ)/θ
    full: Floats = np.eye(3) + first * k + (1.0 - np.sinc(angle / np.pi)) * (k @ k)
    return full[:d, :d]
