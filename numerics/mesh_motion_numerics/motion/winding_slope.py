"""The derivative of the winding of a mesh: see :mod:`.winding`.

With a body's turn θ by the fitted rotation, φ of it, the centre c and the shares g ::

    back = c + R(−φ) (x − c),      y = x̃ + Σ (R(φ g) − 1) (x̃ − c),      x̃ = the plain motion to ``back``

and with the distortion at which cells begin to resist, which grows with φ, the velocities v of the moving nodes have
three effects: on ``back``, on the winding and on that distortion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.decomposition import nearest_rotation_slope
from mesh_motion_numerics.motion.winding import Turns, Winding, fitted_rotation, wound, wound_slope


@dataclass(frozen=True, eq=False)
class _Body:
    """One body that winds the mesh."""

    rows: Integers  # (b,). Its nodes, as rows among the moving nodes
    twist: Floats  # (b, d). dφ for the nodes' velocities
    later: float  # Derivative by φ of the distortion at which cells resist
    #: back, wind: (d, d), (n, d, d). R(−φ), and R(φ g) − 1 at all nodes.
    back: Floats
    wind: Floats
    #: back_turning, turning: (b, d), (n, d). Derivatives of ``back`` and y by φ.
    back_turning: Floats
    turning: Floats


@dataclass(frozen=True, eq=False)
class WindingSlope:
    """The derivative at one mesh."""

    moving: Integers  # (k,). Nodes of the moving boundary
    bodies: tuple[_Body, ...]

    @classmethod
    def build(cls, winding: Winding, turns: Turns, targets: Floats, plain: Floats) -> WindingSlope:
        """Build the derivative for a boundary at ``targets`` (k, d), and the unwound mesh at ``plain`` (n, d)."""
        bodies, d = [], plain.shape[1]
        for body, axis, angle, share, later in zip(
            winding.bodies, turns.axes, turns.after, winding.shares, winding.sheared_slopes(turns), strict=True
        ):
            phi, own = wound(angle), targets[body.rows]
            centre, rest = own.mean(axis=0), winding.reference[winding.moving[body.rows]]
            forth, forth_slope = _turns(axis, phi * share, d)
            back, back_slope = (one[0] for one in _turns(axis, np.array([-phi]), d))
            bodies.append(
                _Body(
                    body.rows,
                    wound_slope(angle) * _twist_slope(rest, own, axis),
                    later,
                    back,
                    forth - np.eye(d),
                    -(own - centre) @ back_slope.T,
                    share[:, None] * np.einsum("nab,nb->na", forth_slope, plain - centre),
                )
            )
        return cls(winding.moving, tuple(bodies))

    def back(self, velocity: Floats) -> Floats:
        """(k, d) velocities of the boundary that is turned back, for velocities of the boundary."""
        out = velocity.copy()
        for body in self.bodies:
            own = velocity[body.rows]
            centre = own.mean(axis=0)
            out[body.rows] = centre + (own - centre) @ body.back.T + np.sum(body.twist * own) * body.back_turning
        return out

    def wound(self, plain: Floats, velocity: Floats) -> Floats:
        """(n, d) velocities of the wound mesh, for (n, d) of the unwound mesh and (k, d) of the boundary."""
        out = plain.copy()
        for body in self.bodies:
            own = velocity[body.rows]
            out += (
                np.einsum("nab,nb->na", body.wind, plain - own.mean(axis=0)) + np.sum(body.twist * own) * body.turning
            )
        out[self.moving] = velocity
        return out

    def later(self, velocity: Floats) -> float:
        """Change of the distortion at which cells begin to resist."""
        return float(sum(body.later * np.sum(body.twist * velocity[body.rows]) for body in self.bodies))

    def unwound(self, weights: Floats, later: float) -> tuple[Floats, Floats]:
        """Derivatives (n, d) and (k, d) with respect to the arguments of :meth:`wound`, for weights (n, d) of its
        result and one weight of :meth:`later`.
        """
        moving, rest = weights[self.moving], weights.copy()
        rest[self.moving] = 0.0
        plain = rest.copy()
        for body in self.bodies:
            turned = np.einsum("nab,na->nb", body.wind, rest)
            plain += turned
            moving[body.rows] -= turned.sum(axis=0) / len(body.rows)
            moving[body.rows] += (np.sum(body.turning * rest) + body.later * later) * body.twist
        return plain, moving

    def back_transposed(self, weights: Floats) -> Floats:
        """The transpose: (k, d) derivatives by the velocities, for weights of :meth:`back`."""
        out = weights.copy()
        for body in self.bodies:
            own = weights[body.rows]
            turned = own @ body.back
            out[body.rows] = turned + (own - turned).mean(axis=0) + np.sum(body.back_turning * own) * body.twist
        return out


def _twist_slope(rest: Floats, own: Floats, axis: int) -> Floats:
    """(b, d) derivative of a body's twist about a coordinate axis by its nodes, from ``rest`` to ``own`` (b, d)."""
    d, arms, fitted = rest.shape[1], rest - rest.mean(axis=0), fitted_rotation(rest, own)
    by_rotation = 0.5 * np.cross(_by_spin(fitted.as_quat(), axis), fitted.as_matrix(), axisb=0, axisc=0)[:d, :d]
    slope = nearest_rotation_slope(((own - own.mean(axis=0)).T @ arms)[None])[0]
    return np.asarray(arms @ np.einsum("ab,abce->ec", by_rotation, slope))


def _by_spin(quaternion: Floats, axis: int) -> Floats:
    """(3,) derivative of the twist 2 atan2(v_axis, w) of a quaternion (v, w) by a small rotation after it."""
    v, w, about = quaternion[:3], quaternion[3], np.eye(3)[axis]
    return np.asarray((w * w * about + w * np.cross(v, about) + v[axis] * v) / (v[axis] ** 2 + w * w))


def _turns(axis: int, angles: Floats, d: int) -> tuple[Floats, Floats]:
    """(n, d, d) rotations about a coordinate axis by angles (n,), and their derivatives."""
    one, other = ((1, 2), (2, 0), (0, 1))[axis]
    turn, slope = np.tile(np.eye(d), (len(angles), 1, 1)), np.zeros((len(angles), d, d))
    sine, cosine = np.sin(angles), np.cos(angles)
    turn[:, one, one] = turn[:, other, other] = slope[:, other, one] = cosine
    turn[:, other, one] = sine
    turn[:, one, other] = slope[:, one, one] = slope[:, other, other] = -sine
    slope[:, one, other] = -cosine
    return turn, slope
