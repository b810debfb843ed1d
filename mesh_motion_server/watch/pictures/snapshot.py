"""A mesh at one time for a picture, and the part of it that a picture shows."""

from dataclasses import dataclass

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.cells import CellTable

#: A picture shows only the surroundings of the moving nodes if these take less than this share of it.
_CROP_BELOW = 0.4
#: Along an axis with a smaller share of the sum of squares nodes do not move.
_STILL = 1e-6
#: Width of the surroundings around the moving nodes, as a share of their largest extent.
_MARGIN = 0.5
#: The least margin, as a share of the whole picture: nodes may move at one place only.
_LEAST_MARGIN = 0.02


@dataclass(frozen=True, eq=False)
class Snapshot:
    """A mesh at one time, with the data that a picture needs."""

    step: int  # 0 at opening
    points: Floats  # (n, d)
    cells: CellTable
    quality: Floats  # (m,). Quality of each cell
    moving: Integers  # (k,). The moving nodes
    #: (m,) bool. The inverted cells; if omitted, cells of quality 0 or less, as for a metric that includes
    #: the size.
    folded: Marks | None = None
    scale: tuple[float, float] = (0.0, 1.0)  # (bad, good). Values at the ends of the colour map

    @property
    def inverted(self) -> Marks:
        """(m,) whether each cell is inverted."""
        return self.quality <= 0 if self.folded is None else self.folded

    @property
    def worst(self) -> int:
        """Number of the worst cell."""
        return int(np.argmin(self.badness))

    @property
    def badness(self) -> Floats:
        """(m,) values that order the cells, the worst lowest."""
        return self.quality if self.scale[1] > self.scale[0] else -self.quality

    @property
    def extreme(self) -> str:
        """The worst value, in words."""
        name = "minimum" if self.scale[1] > self.scale[0] else "maximum"
        return f"{name} {self.quality[self.worst]:.3f}"

    def centre(self, cell: int) -> Floats:
        """(d,) mean of a cell's nodes."""
        block, row = self.cells.locate(cell)
        return np.asarray(self.points[block.nodes[row]].mean(axis=0))


@dataclass(frozen=True)
class Plane:
    """The cut of a 3D mesh: x[axis] = position. A 2D mesh has no plane."""

    axis: int
    position: float


def choose_plane(before: Snapshot, after: Snapshot) -> Plane | None:
    """The plane that shows most of a 3D motion: across the axis of least motion, through the nodes that move most.

    Of several axes without motion it is across the shortest one, which is that of one layer of cells.
    """
    if before.points.shape[1] < 3:
        return None
    start, moved = before.points[before.moving], after.points[after.moving]
    squares = (moved - start) ** 2
    along, extent = squares.sum(axis=0), np.ptp(after.points, axis=0)
    axis = int(np.lexsort((extent, np.maximum(along, _STILL * along.max())))[0])
    if not len(moved):
        return Plane(axis, float(after.points[:, axis].mean()))
    weight = squares.sum(axis=1)
    position = float(np.average(moved[:, axis], weights=weight) if weight.any() else moved[:, axis].mean())
    return Plane(axis, position)


def choose_window(before: Snapshot, after: Snapshot, plane: Plane | None) -> Floats:
    """(2, 2) lower and upper corner of the part of the picture where nodes move, or of the whole picture."""
    dimension = before.points.shape[1]
    drawn = [axis for axis in range(dimension) if plane is None or axis != plane.axis]
    both = np.concatenate([before.points, after.points])[:, drawn]
    low, high = both.min(axis=0), both.max(axis=0)
    if dimension == 1:
        return np.array([[low[0], 0.0], [high[0], 1.0]])
    moving = np.concatenate([before.points[before.moving], after.points[after.moving]])
    if plane is not None:
        distance = np.abs(moving[:, plane.axis] - plane.position)
        moving = moving[distance <= max(0.1 * float(np.ptp(moving[:, plane.axis])), float(distance.min()))]
    return _around(moving[:, drawn], low, high)


def _around(moving: Floats, low: Floats, high: Floats) -> Floats:
    """(2, d) box around places (k, d), or the box from ``low`` to ``high`` if that is not much larger."""
    if not len(moving):
        return np.array([low, high])
    margin = max(_MARGIN * float(np.ptp(moving, axis=0).max()), _LEAST_MARGIN * float((high - low).max()))
    near_low, near_high = np.maximum(moving.min(axis=0) - margin, low), np.minimum(moving.max(axis=0) + margin, high)
    is_small = np.prod(near_high - near_low) < _CROP_BELOW * np.prod(high - low)
    return np.array([near_low, near_high] if is_small else [low, high])
