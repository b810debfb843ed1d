"""2D polygons of a mesh for drawing: the cells of a 2D mesh, or a 3D mesh's cells cut by a plane."""

from dataclasses import dataclass

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.cells import CellTable

#: The edges of each type of volume cell, as pairs of local nodes.
_EDGES: dict[str, tuple[tuple[int, int], ...]] = {
    "tetra": ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)),
    "hexahedron": (
        (0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7),
    ),
    "wedge": ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    "pyramid": ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
}  # fmt: skip
#: Largest number of corners of a hexahedron's cut.
_MOST_CORNERS = 6


@dataclass(frozen=True, eq=False)
class Polygons:
    """Polygons, with the number of each polygon's cell."""

    corners: Floats  # (p, k, 2). Polygons of fewer corners repeat their last one
    cells: Integers  # (p,)


def flat(points: Floats, cells: CellTable) -> Polygons:
    """The cells of a 2D mesh (points (n, 2)) themselves."""
    width = max(block.nodes.shape[1] for block in cells)
    nodes = [np.pad(block.nodes, ((0, 0), (0, width - block.nodes.shape[1])), mode="edge") for block in cells]
    return Polygons(points[np.concatenate(nodes)], np.arange(len(cells)))


def cut(points: Floats, cells: CellTable, axis: int, position: float) -> Polygons:
    """The cut of a 3D mesh by the plane x[axis] = position, drawn in the other two axes.

    A cell's cut is the polygon of the points where its edges cross the plane, in the order of their angle about their
    mean; exact for convex cells with plane faces.
    """
    height = points[:, axis] - position
    height = np.where(height == 0.0, 1e-300, height)  # a node on the plane counts as above it
    drawn = [i for i in range(3) if i != axis]
    corners, numbers = [np.empty((0, _MOST_CORNERS, 2))], [np.empty(0, dtype=np.int64)]
    for block, span in cells.numbered:
        above = height[block.nodes] > 0
        rows = np.flatnonzero(above.any(axis=1) & ~above.all(axis=1))
        a, b = np.moveaxis(block.nodes[rows][:, _EDGES[block.type.name]], 2, 0)
        share = height[a] / np.where(crosses := (height[a] > 0) != (height[b] > 0), height[a] - height[b], np.inf)
        places = (points[a] + share[:, :, None] * (points[b] - points[a]))[:, :, drawn]
        corners.append(_around(places, crosses))
        numbers.append(span.start + rows)
    return Polygons(np.concatenate(corners), np.concatenate(numbers))


def _around(places: Floats, valid: Marks) -> Floats:
    """(p, k, 2) the valid points of (p, e, 2), in the order of their angle about their mean, the last one repeated."""
    count = valid.sum(axis=1)[:, None]
    middle = np.where(valid[:, :, None], places, 0.0).sum(axis=1) / count
    x, y = np.moveaxis(places - middle[:, None], 2, 0)
    order = np.argsort(np.where(valid, np.arctan2(y, x), np.inf), axis=1, kind="stable")
    kept = np.take_along_axis(order, np.minimum(np.arange(_MOST_CORNERS), count - 1), axis=1)
    return np.take_along_axis(places, kept[:, :, None], axis=1)
