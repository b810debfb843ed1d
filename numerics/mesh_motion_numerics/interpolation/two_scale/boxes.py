"""Nested boxes of a grid that is finer where the coarse points are closer.

The coarse field varies on the scale of its points' spacing near them and more slowly away from them. Level l has the
grid spacing ``h₀ / 2^l`` and covers, with a margin, the coarse points that are too close to each other for the level
before. Points near each other share a box; the boxes of a level are disjoint.
"""

import math
from dataclasses import dataclass

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers

#: Number of cells along the longest side of the domain on the coarsest level.
_CELLS = 32
#: Number of cells of a box beyond its coarse points.
MARGIN = 10
#: Largest spacing of the grid, in spacings of the coarse points.
_RESOLUTION = 2.6
#: Largest number of grid points of all boxes together; finer levels that would exceed it are left out.
_MAX_POINTS = 600_000
_MAX_LEVELS = 24


@dataclass(frozen=True, eq=False)
class Box:
    """Cells of one spacing."""

    level: int
    spacing: float  # mesh length unit
    first: Integers  # (3,). Grid index of its lower corner, counted on its level from the domain's lower corner
    cells: Integers  # (3,). Along each axis; 0 along one that the domain does not have
    parent: int  # Number of the box of the level before that contains it; −1 for the domain

    @property
    def grid_points(self) -> int:
        """Number of points at which the field is evaluated: two more than the box's own on every side."""
        return math.prod(n + 5 if n > 0 else 1 for n in self.cells.tolist())


def nested_boxes(coarse: Floats, closeness: Floats, low: Floats, high: Floats) -> list[Box]:
    """Boxes, coarsest first, for coarse points (m, 3) in the domain from ``low`` to ``high`` (3,).

    ``closeness`` (m,) is each point's distance to the nearest other one.

    Every box lies within its parent.
    """
    extent = high - low
    spacing = float(extent.max()) / _CELLS
    whole = np.where(extent > 0.0, np.maximum(np.ceil(extent / spacing - 1e-9), 1.0), 0.0).astype(np.int64)
    boxes = [Box(0, spacing, np.zeros(3, dtype=np.int64), whole, -1)]
    if len(coarse) < 2:
        return boxes
    last = boxes
    for level in range(1, _MAX_LEVELS):
        fine = coarse[closeness < spacing / _RESOLUTION]
        spacing /= 2.0
        found = _level(level, spacing, fine, low, last, len(boxes) - len(last))
        if not found or sum(box.grid_points for box in (*boxes, *found)) > _MAX_POINTS:
            return boxes
        boxes.extend(found)
        last = found
    return boxes


def _level(level: int, spacing: float, fine: Floats, low: Floats, parents: list[Box], offset: int) -> list[Box]:
    """The boxes around the points ``fine`` (m, 3), each cut to the parent that contains its points."""
    boxes = []
    place = (fine - low) / spacing
    for number, parent in enumerate(parents):
        floor, ceiling = 2 * parent.first, 2 * (parent.first + parent.cells)
        inside = np.all((place >= floor) & (place <= ceiling), axis=1)
        for first, last in _merged(place[inside]):
            # even: a child's corner is a grid point of its parent
            a = np.maximum(first // 2 * 2, floor)
            b = np.minimum((last + 1) // 2 * 2, ceiling)
            boxes.append(Box(level, spacing, a, b - a, offset + number))
    return boxes


def _merged(place: Floats) -> list[tuple[Integers, Integers]]:
    """Corners of disjoint boxes around points (m, 3), in spacings, with a margin."""
    if not len(place):
        return []
    # points in one cell of this side are near each other; boxes of neighbouring cells touch
    cells = np.floor(place / MARGIN).astype(np.int64)
    label = np.unique(cells @ (1 << 40, 1 << 20, 1), return_inverse=True)[1]
    boxes = []
    for group in (place[label == number] for number in range(label.max() + 1)):
        low, high = group.min(axis=0) - MARGIN, group.max(axis=0) + MARGIN
        boxes.append((np.floor(low).astype(np.int64), np.ceil(high).astype(np.int64)))
    return _united(sorted(boxes, key=lambda box: tuple(box[0])))


def _united(boxes: list[tuple[Integers, Integers]]) -> list[tuple[Integers, Integers]]:
    """The boxes after replacing touching boxes by their common bounding box until none touch."""
    done: list[tuple[Integers, Integers]] = []
    while boxes:
        low, high = boxes.pop(0)
        touching = [i for i, (a, b) in enumerate(done) if bool(((a <= high + 2) & (b >= low - 2)).all())]
        if not touching:
            done.append((low, high))
            continue
        other = done.pop(touching[0])
        boxes.insert(0, (np.minimum(low, other[0]), np.maximum(high, other[1])))
    return done
