"""Positions that both sides know, and the rows in which other positions differ from them.

Few rows change between two tasks: the boundary nodes are put at their targets, and a correction moves some more. So
only these rows are sent; for the others the workers use their own results.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.distributed.held import Positions
from mesh_motion_server.numerics.mesh.points import bounding_box

__all__ = ["Changed", "Version", "Versions"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Number of rows that are compared to find the nearest version.
_SAMPLE = 2000


@dataclass(frozen=True, eq=False)
class Version:
    """Positions of all nodes, as the workers have them.

    Attributes
    ----------
    number : int
    points : (n, d) array, mesh length unit
        Never changed afterwards.
    boxes : tuple of (2, d) arrays
        Of each partition's nodes.
    """

    number: int
    points: Floats
    boxes: tuple[Floats, ...]


@dataclass(frozen=True, eq=False)
class Changed:
    """Positions as differences from a version.

    Attributes
    ----------
    version : Version
    points : (n, d) array
    rows : (k,) int64 array
        Nodes, ascending, whose position differs from the version's.
    """

    version: Version
    points: Floats
    rows: Ints

    def to(self, nodes: Ints, *, whole: bool) -> Positions:
        """Return the positions for a partition with these nodes (p,), ascending.

        With ``whole`` it may have lost all versions but the reference.
        """
        if (whole and self.version.number) or self._mostly_others:
            return Positions(None, None, self.points[nodes])
        places = np.searchsorted(nodes, self.rows)
        here = nodes[np.minimum(places, len(nodes) - 1)] == self.rows
        return Positions(self.version.number, places[here], self.points[self.rows[here]])

    @property
    def _mostly_others(self) -> bool:
        """Return whether the rows would take more bytes than all positions."""
        return len(self.rows) * 2 > len(self.points)

    def box(self, number: int, nodes: Ints) -> Floats:
        """(2, d) box of a partition's nodes."""
        if self._mostly_others:
            return bounding_box(self.points[nodes])
        values = self.to(nodes, whole=False).values
        box = self.version.boxes[number]
        if values is None or not len(values):
            return box
        moved = bounding_box(values)
        return np.stack([np.minimum(box[0], moved[0]), np.maximum(box[1], moved[1])])


class Versions:
    """The known versions: the reference mesh, and a few others."""

    def __init__(self, reference: Version) -> None:
        self._known = {"reference": reference}
        self._last = reference.number

    @property
    def numbers(self) -> tuple[int, ...]:
        """Numbers of the versions that workers must keep."""
        return tuple(version.number for version in self._known.values())

    def next(self) -> int:
        """Return a number for a new version."""
        self._last += 1
        return self._last

    def know(self, name: str, number: int, points: Floats, boxes: Sequence[Floats]) -> None:
        """Add a version; it replaces the last one of this name. ``points`` must not change any more."""
        self._known[name] = Version(number, points, tuple(boxes))

    def changed(self, points: Floats) -> Changed:
        """Express positions (n, d) as differences from the nearest version."""
        stride = max(len(points) // _SAMPLE, 1)
        some = points[::stride]
        nearest = min(self._known.values(), key=lambda version: np.count_nonzero(version.points[::stride] != some))
        differs = points != nearest.points
        rows = differs[:, 0].copy()
        for axis in range(1, points.shape[1]):
            rows |= differs[:, axis]
        return Changed(nearest, points, np.flatnonzero(rows))
