"""The motions: large rigid motions in one step or in equal sub-steps, and bending.

After step s of S a rigid motion displaces a node at X by u = s/S t + (R(s/S θ) - I)(X - c), as in a case file.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["MOTIONS", "Bending", "Motion", "RigidMotion"]

Floats = NDArray[np.float64]


class Motion(Protocol):
    """The displacement of boundary nodes."""

    @property
    def text(self) -> str:
        """In words."""
        ...

    def displacements(self, points: Floats, steps: int) -> Floats:
        """(steps, k, d) total displacement of the points (k, d) after each step."""
        ...


@dataclass(frozen=True)
class RigidMotion:
    """A rotation in the x–y plane about a centre, then a translation.

    Attributes
    ----------
    translation, centre : tuples of d floats
        In the mesh's unit; in 3D the axis is z.
    """

    text: str
    translation: tuple[float, ...]
    centre: tuple[float, ...]
    degrees: float

    def displacements(self, points: Floats, steps: int) -> Floats:
        """As :meth:`Motion.displacements`."""
        return np.stack([self._displacement(points, (step + 1) / steps) for step in range(steps)])

    def _displacement(self, points: Floats, fraction: float) -> Floats:
        angle = fraction * np.radians(self.degrees)
        rotation = np.eye(points.shape[1])
        rotation[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        arm = points - np.array(self.centre)
        displacement: Floats = fraction * np.array(self.translation) + arm @ rotation.T - arm
        return displacement


@dataclass(frozen=True)
class Bending:
    """A cantilever along x under a tip load: u_y = a t² (3 - t) / 2, t from 0 at the root to 1 at the tip.

    Attributes
    ----------
    amplitude : float
        Displacement a of the tip.
    root, tip : float
        Coordinates x.
    """

    text: str
    amplitude: float
    root: float = 0.3
    tip: float = 0.7

    def displacements(self, points: Floats, steps: int) -> Floats:
        """Displacements as in :meth:`Motion.displacements`, in steps of equal amplitude."""
        t = (points[:, 0] - self.root) / (self.tip - self.root)
        displacements = np.zeros((steps, *points.shape))
        displacements[:, :, 1] = np.linspace(0, self.amplitude, steps + 1)[1:, None] * t**2 * (3 - t) / 2
        return displacements


MOTIONS: dict[str, Motion] = {
    "T1": RigidMotion("translate (−0.2, −0.2), rotate 60°", (-0.2, -0.2), (0.5, 0.5), 60.0),
    "T2": Bending("bend, tip +40 % of the span", 0.16),
    "T2s": Bending("bend, tip +6 % of the span", 0.024),
    "T3": RigidMotion("translate −0.15 in y, rotate 30° about z", (0.0, -0.15, 0.0), (0.5, 0.5, 0.5), 30.0),
}
