"""Translations and rotations that map a periodic side onto its partner, and the group that they generate."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_numerics.arrays import Floats

#: Elements that differ by less (a rotation's entries, a shift relative to the scale) are equal up to rounding.
_SAME = 1e-6
_MOST_ELEMENTS = 20_000
_ROUNDING = 1e-14  # of an angle


@dataclass(frozen=True, eq=False)
class Transform:
    """``x → R x + s``."""

    rotation: Floats  # (d, d). R
    shift: Floats  # (d,), mesh length unit. s

    @classmethod
    def identity(cls, dimension: int) -> Transform:
        return cls(np.eye(dimension), np.zeros(dimension))

    @classmethod
    def translation(cls, shift: Floats) -> Transform:
        return cls(np.eye(len(shift)), shift)

    @classmethod
    def about(cls, centre: Floats, angle: float, axis: Floats | None = None) -> Transform:
        """Rotation by an angle about a point in 2D, or about an axis (3,) through a point in 3D."""
        if axis is None:
            c, s = math.cos(angle), math.sin(angle)
            rotation = np.array([[c, -s], [s, c]])
        else:
            cross = cross_matrix(axis)
            rotation = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross  # Rodrigues
        return cls(rotation, centre - rotation @ centre)

    @property
    def turns(self) -> bool:
        """Whether the transform rotates."""
        return not np.array_equal(self.rotation, np.eye(len(self.shift)))

    @property
    def angle(self) -> float:
        """Angle of the rotation: signed in 2D, 0 … π in 3D."""
        r = self.rotation
        if len(r) == 2:
            return math.atan2(r[1, 0], r[0, 0])
        skew = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
        return math.atan2(0.5 * float(np.linalg.norm(skew)), 0.5 * (float(np.trace(r)) - 1.0))

    @property
    def sectors(self) -> int:
        """The number N of a rotation by 1/N of a turn, up to rounding; 0 for another one, or none."""
        angle = abs(self.angle)
        count = round(2.0 * math.pi / angle) if self.turns else 0
        return count if abs(count * angle - 2.0 * math.pi) <= _ROUNDING * count else 0

    def __call__(self, points: Floats) -> Floats:
        """Images (n, d) of points (n, d)."""
        return np.asarray(points @ self.rotation.T + self.shift) if self.turns else points + self.shift

    def after(self, first: Transform) -> Transform:
        """The transform that applies ``first`` and then this one."""
        rotation = self.rotation @ first.rotation if self.turns else first.rotation
        return Transform(rotation, self.rotation @ first.shift + self.shift)

    def inverse(self) -> Transform:
        """The inverse transform."""
        return Transform(self.rotation.T, -(self.rotation.T @ self.shift) if self.turns else -self.shift)


def cross_matrix(a: Floats) -> Floats:
    """(3, 3) matrix of the cross product a × …."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def generated_group(
    generators: Sequence[Transform], dimension: int, scale: float, wanted: Callable[[Transform], bool]
) -> list[Transform]:
    """The wanted elements of the group of the generators and their inverses, the identity first.

    Elements are found only through wanted elements: ``wanted`` says whether the images of a bounded set come near.

    Raises InvalidInput if there are more than 20 000.

    Parameters
    ----------
    scale : float, mesh length unit
        Scale of the shifts, to distinguish elements.
    """
    steps = [step for generator in generators for step in (generator, generator.inverse())]
    found = [Transform.identity(dimension)]
    known = {_key(found[0], scale)}
    for element in found:  # the list grows during the loop
        for step in steps:
            further = step.after(element)
            key = _key(further, scale)
            if key in known:
                continue
            known.add(key)
            if wanted(further):
                found.append(further)
        if len(found) > _MOST_ELEMENTS:
            raise InvalidInput(
                f"support_radius reaches across more than {_MOST_ELEMENTS} periodic images",
                code="INVALID_ARGUMENT.SETTINGS",
                hint="take a smaller support_radius: a few periods are enough",
                details={"setting": "support_radius"},
            )
    return found


def _key(element: Transform, scale: float) -> bytes:
    """A key that is the same for elements that are equal up to rounding."""
    numbers = np.concatenate([element.rotation.ravel(), element.shift / scale])
    return np.asarray(np.round(numbers / _SAME) + 0.0).tobytes()


def nearest_images(places: Floats, reference: Floats, generators: Sequence[Transform]) -> tuple[Floats, Floats, Floats]:
    """The periodic image of each place that is nearest to its reference, found one period at a time.

    Parameters
    ----------
    places, reference : (m, d) arrays, mesh length unit

    Returns
    -------
    (m, d), (m, d, d), (m, d) arrays
        The images, and R, s of the inverse: place = R image + s. For a place that is already the nearest, bitwise the
        identity.
    """
    near, shifts = places.copy(), np.zeros(places.shape)
    rotations = np.broadcast_to(np.eye(places.shape[1]), (*places.shape, places.shape[1])).copy()
    for step in [s for generator in generators for s in (generator, generator.inverse())]:
        rows, back = np.arange(len(places)), step.inverse()
        while len(rows):
            image = back(near[rows])
            before, after = (np.sum((at - reference[rows]) ** 2, axis=1) for at in (near[rows], image))
            nearer = after < before * (1.0 - _SAME)
            rows = rows[nearer]
            near[rows] = image[nearer]
            shifts[rows] += rotations[rows] @ step.shift
            rotations[rows] = rotations[rows] @ step.rotation
    return near, rotations, shifts
