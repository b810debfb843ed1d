"""Sectors whose angle is not a whole fraction of a turn: images overlap after a turn, so only the near ones count.

The images at k A, A the angle, belong to a staircase of sectors without end: those after a turn are at the same places
as the first ones, but are not the first ones. An interpolation with compact support repeats exactly with such sectors
if its support does not reach around the axis: with r the smallest distance of a node from the axis, and W the angle
that all nodes span, for ``R ≤ 2 r cos(W/2)``. Two places nearer than R are then less than π − W apart around the axis,
so the images up to some k have all such places, and none from the next turn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.mesh.revolution import across
from mesh_motion_numerics.mesh.rigid_transforms import Transform

_SAME = 1e-6  # a radius below this share of the mesh counts as 0
#: Share of the largest radius that is suggested: rounded to two digits, it is below the largest.
_SUGGESTED = 0.95


@dataclass(frozen=True, eq=False)
class OpenSector:
    """The sector of a mesh."""

    turn: Transform  # The rotation by the sector's angle
    others: tuple[Transform, ...]  # The other generators of the periodic images
    #: angle, width: A and W.
    angle: float
    width: float
    inner: float  # mesh length unit. r

    @classmethod
    def of(cls, points: Floats, generators: Sequence[Transform]) -> OpenSector | None:
        """The sector of a mesh at ``points`` (n, d); None if no angle is open.

        Raises InvalidInput if a support cannot repeat: the mesh reaches the axis or spans half a turn, or other periods
        rotate too.
        """
        turn = next((one for one in generators if one.turns and not one.sectors), None)
        if turn is None:
            return None
        others = tuple(one for one in generators if one is not turn)
        angle = abs(turn.angle)
        what = f"the periodic sides are {math.degrees(angle):.6g}° apart, no whole fraction of a turn"
        if any(one.turns for one in others):
            raise _refused(f"{what}, and other periods rotate too")
        arms = across(turn, points)
        inner = float(np.linalg.norm(arms, axis=1).min())
        middle = arms.mean(axis=0)
        side = turn.rotation @ middle
        side = side - middle * (side @ middle) / (middle @ middle)
        place = np.arctan2(arms @ side / np.linalg.norm(side), arms @ middle / np.linalg.norm(middle))
        width = float(np.ptp(place))
        found = cls(turn, others, angle, width, inner)
        if width >= math.pi or found.largest_radius < _SAME * float(np.ptp(points, axis=0).max()):
            raise _refused(
                f"{what}: expected a mesh that spans less than half a turn and does not reach the axis, got "
                f"{math.degrees(width):.4g}° and {inner:.3g} from the axis"
            )
        return found

    @property
    def largest_radius(self) -> float:
        """The largest support radius, mesh length unit."""
        return 2.0 * self.inner * math.cos(0.5 * self.width)

    @property
    def suggested_radius(self) -> float:
        """The largest support radius that is suggested, mesh length unit, rounded to two digits."""
        return float(f"{_SUGGESTED * self.largest_radius:.2g}")

    def check(self, radius: float) -> None:
        """Refuse a support radius that reaches around the axis."""
        if radius > self.largest_radius:
            degrees = math.degrees(self.angle)
            raise InvalidInput(
                f"support_radius = {radius!r}: expected at most {self.largest_radius:.3g}, else the support reaches "
                f"around the axis of the periodic sector of {degrees:.6g}°, which is not a whole fraction of a turn",
                code="INVALID_ARGUMENT.SETTINGS",
                hint="leave it out, or take a smaller one",
                details={"setting": "support_radius"},
            )

    def turns(self, radius: float) -> list[Transform]:
        """The rotations to the images within a support radius, the identity first."""
        reach = 2.0 * math.asin(min(1.0, radius / (2.0 * self.inner))) + self.width
        found = [Transform.identity(len(self.turn.shift))]
        for step in (self.turn, self.turn.inverse()):
            last = found[0]
            for _ in range(math.ceil(reach / self.angle) - 1):
                last = step.after(last)
                found.append(last)
        return found


def _refused(message: str) -> InvalidInput:
    return InvalidInput(
        message,
        code="INVALID_ARGUMENT.MESH",
        hint="mesh a sector that is a whole fraction of a turn, such as 360°/7, or the whole ring",
    )
