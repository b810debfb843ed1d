"""The motions: large rigid ones, in one step or in equal sub-steps of angle and translation.

After step s of S a node at X is displaced by u = s/S t + (R(s/S θ) - I)(X - c), as in a case file.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["MOTIONS", "RigidMotion"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class RigidMotion:
    """A rotation in the x–y plane about a centre, then a translation.

    Attributes
    ----------
    text : str
    translation, centre : tuples of d floats
        In the mesh's unit; in 3D the axis is z.
    degrees : float
    """

    text: str
    translation: tuple[float, ...]
    centre: tuple[float, ...]
    degrees: float

    def displacements(self, points: Floats, steps: int) -> Floats:
        """(steps, k, d) total displacement of the points (k, d) after each step."""
        return np.stack([self._displacement(points, (step + 1) / steps) for step in range(steps)])

    def _displacement(self, points: Floats, fraction: float) -> Floats:
        angle = fraction * np.radians(self.degrees)
        rotation = np.eye(points.shape[1])
        rotation[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        arm = points - np.array(self.centre)
        displacement: Floats = fraction * np.array(self.translation) + arm @ rotation.T - arm
        return displacement


MOTIONS: dict[str, RigidMotion] = {
    "T1": RigidMotion("translate (−0.2, −0.2), rotate 60°", (-0.2, -0.2), (0.5, 0.5), 60.0),
    "T3": RigidMotion("translate −0.15 in y, rotate 30° about z", (0.0, -0.15, 0.0), (0.5, 0.5, 0.5), 30.0),
}
