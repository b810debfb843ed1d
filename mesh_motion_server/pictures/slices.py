"""Plane polygons of a mesh for drawing: the cells of a 2D mesh, or a 3D mesh's cells cut by a plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.cells import CellTable

__all__ = ["Polygons", "cut", "flat"]

FloatArray = NDArray[np.float64]

#: The edges of each type of volume cell, as pairs of local nodes.
_EDGES: dict[str, tuple[tuple[int, int], ...]] = {
    "tetra": ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)),
    "hexahedron": (
        (0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7),
    ),
    "wedge": ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    "pyramid": ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Polygons:
    """Polygons with the number of the cell each belongs to.

    Attributes
    ----------
    corners : list of (k, 2) arrays
    cells : (p,) int64 array
    """

    corners: list[FloatArray]
    cells: NDArray[np.int64]


def flat(points: FloatArray, cells: CellTable) -> Polygons:
    """The cells of a 2D mesh (points (n, 2)) themselves."""
    corners = [polygon for block in cells for polygon in points[block.nodes]]
    return Polygons(corners, np.arange(len(cells)))


def cut(points: FloatArray, cells: CellTable, axis: int, position: float) -> Polygons:
    """The cut of a 3D mesh by the plane x[axis] = position, drawn in the other two axes.

    A cell's cut is the polygon of the points where its edges cross the plane, in the order of their angle about their
    mean; exact for convex cells with plane faces.
    """
    height = points[:, axis] - position
    height = np.where(height == 0.0, 1e-300, height)  # a node on the plane counts as above it
    drawn = [i for i in range(3) if i != axis]
    corners: list[FloatArray] = []
    numbers: list[int] = []
    for block, first in zip(cells, cells.offsets, strict=False):
        edges = np.array(_EDGES[block.type.name])
        signs = height[block.nodes] > 0
        for row in np.flatnonzero(signs.any(axis=1) & ~signs.all(axis=1)):
            a, b = block.nodes[row][edges].T
            crossing = (height[a] > 0) != (height[b] > 0)
            a, b = a[crossing], b[crossing]
            share = (height[a] / (height[a] - height[b]))[:, None]
            places = (points[a] + share * (points[b] - points[a]))[:, drawn]
            corners.append(_around(places))
            numbers.append(first + int(row))
    return Polygons(corners, np.array(numbers, dtype=np.int64))


def _around(places: FloatArray) -> FloatArray:
    """(k, 2) points in the order of their angle about their mean."""
    x, y = (places - places.mean(axis=0)).T
    return places[np.argsort(np.arctan2(y, x), kind="stable")]
