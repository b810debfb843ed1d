"""Finds the nodes that belong to the boundary layers of the moving walls.

A node belongs to a layer if it is no farther than the thickness from every facet that meets at its nearest place of the
wall: around a convex corner the layer ends at the mitre of the two offset walls, as layers of quads and prisms do, and
not at an arc. Sharp edges, whose mitre is far away, are cut at √d thicknesses.

Near other boundaries the layer is thinner: its nodes are no farther from the wall than half their distance to a
periodic side, another body or a wall at rest. So a third of a gap between two walls stays free to deform. A wall on
which nodes slide limits the layer only where it faces the body. If the body stands on such a wall, the layer's nodes on
this wall are put back onto it.

In 2D the first cells at a body without thin cells are a layer as well, if they are small against the body and against
its distance from other boundaries. A larger layer makes the body larger, and the cells around it lose their shape.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.boundary_layer_stacks import column_feet
from mesh_motion_numerics.mesh.boundary_layer_wall import MovingWall, WallPlaces
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.closest_point import nearest_within
from mesh_motion_numerics.mesh.points import bounding_box, marks_at
from mesh_motion_numerics.mesh.roles import SLIDING_ROLES, Patch, nodes_with
from mesh_motion_numerics.mesh.smooth_pieces import as_simplices, of_one_width

_SHARE = 0.5  # a layer may reach this share of the distance to another boundary
#: The first cells may reach this share of that distance, and of the body's longest side. A square in the middle of a
#: box of its double size, with cells of a sixth of the gap, keeps 0.81 of its cells' shape at 15° instead of 0.85; a
#: circle with cells of 0.06 of its diameter keeps 0.971 instead of 0.975.
_FIRST_SHARE, _OF_BODY = 0.1, 0.06
_FACING = -0.8  # cosine between the directions to the wall and to a sliding wall: opposite sides, within 37°
_ROUNDING = 1e-6  # added share of the thickness, so that the layer's outermost nodes belong to it


class LayerNodes(NamedTuple):
    """Nodes (l,), ascending, the places of the wall to which they are tied, and their offsets (l, d) from these."""

    nodes: Integers
    places: WallPlaces
    offsets: Floats

    def chosen(self, rows: Marks) -> LayerNodes:
        """The nodes for which ``rows`` (l,) is true."""
        places = WallPlaces(self.places.corners[rows], self.places.weights[rows])
        return LayerNodes(self.nodes[rows], places, self.offsets[rows])


def layer_nodes(
    points: Floats,
    cells: CellTable,
    facets: Mapping[str, Integers],
    patches: Mapping[str, Patch],
    wall: MovingWall,
    thickness: float,
) -> LayerNodes:
    """The layer's nodes.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
        Reference coordinates.
    cells : CellTable
        At least the cells with a node within √d thicknesses of the wall.
    facets : mapping of type to (f, k) array
        The whole boundary.
    thickness : float, mesh length unit
    """
    limit = (1.0 + _ROUNDING) * thickness
    nodes = np.setdiff1d(np.arange(len(points)), nodes_with(patches, ("moving", "fixed", "periodic")))
    places, own = wall.closest(points[nodes], within=furthest(thickness, points.shape[1]))
    found = LayerNodes(nodes, places, points[nodes] - places.of(wall.reference))
    inside = own >= 0
    inside[inside] = _height(wall, found.chosen(inside)) <= limit
    found, own = found.chosen(inside), own[inside]
    found = found.chosen(~_crowded(points, facets, patches, wall, found, own, _SHARE))
    return _on_columns(found, points, cells, wall)


def first_row(
    points: Floats, cells: CellTable, facets: Mapping[str, Integers], patches: Mapping[str, Patch], wall: MovingWall
) -> LayerNodes:
    """The nodes of the cells that touch a body of a plane mesh, in the manner of :func:`layer_nodes`.

    A body is a closed wall in the interior of the mesh's box: other walls have no far side that would turn with them.
    ``cells``: at least those with a node on the wall or in the first row.
    """
    sides = wall.body_sides(bounding_box(points))
    on_body = marks_at(len(points), wall.nodes[wall.simplices[sides > 0.0]])
    touching = marks_at(len(points), *(block.nodes[on_body[block.nodes].any(axis=1)] for block in cells))
    touching[nodes_with(patches, ("moving", "fixed", "periodic"))] = False
    nodes = np.flatnonzero(touching)
    places, own = wall.closest(points[nodes])
    found = LayerNodes(nodes, places, points[nodes] - places.of(wall.reference))
    large = np.linalg.norm(found.offsets, axis=1) > _OF_BODY * sides[own]
    crowded = _crowded(points, facets, patches, wall, found, own, _FIRST_SHARE)
    body = wall.bodies[own]
    count, many, near = (np.bincount(body, of, body.max(initial=0) + 1) for of in (None, large, crowded))
    admitted = (2 * many <= count) & (near == 0)  # a part of the row would be worse than none
    return _on_columns(found.chosen(admitted[body]), points, cells, wall)


def furthest(thickness: float, dimension: int) -> float:
    """The largest distance of a layer's nodes from the wall, mesh length unit."""
    return (1.0 + _ROUNDING) * thickness * float(np.sqrt(dimension))


def _on_columns(found: LayerNodes, points: Floats, cells: CellTable, wall: MovingWall) -> LayerNodes:
    """The nodes tied to the foot of their column instead of their nearest place, if they are in a column."""
    feet = column_feet(points, cells, wall.nodes, found.nodes, np.linalg.norm(found.offsets, axis=1))
    corners, weights = found.places.corners.copy(), found.places.weights.copy()
    rows = np.flatnonzero(feet[found.nodes] >= 0)
    corners[rows] = np.searchsorted(wall.nodes, feet[found.nodes[rows]])[:, None]
    weights[rows] = np.eye(weights.shape[1])[0]
    places = WallPlaces(corners, weights)
    return LayerNodes(found.nodes, places, points[found.nodes] - places.of(wall.reference))


def _height(wall: MovingWall, found: LayerNodes) -> Floats:
    """(l,) largest distance of each node from the planes of the facets that meet at its place."""
    corners, weights = found.places
    d = corners.shape[1]
    order = np.argsort(wall.simplices.ravel(), kind="stable")
    starts = np.searchsorted(wall.simplices.ravel()[order], np.arange(len(wall.nodes) + 1))
    around = np.take_along_axis(corners, np.argmax(weights, axis=1)[:, None], axis=1)[:, 0]
    count = starts[around + 1] - starts[around]
    row = np.repeat(np.arange(len(corners)), count)
    facet = order[np.arange(count.sum()) - np.repeat(np.cumsum(count) - count - starts[around], count)] // d
    meets = np.ones(len(row), dtype=bool)
    for j in range(d):  # the facet contains every corner that the place touches
        meets &= (weights[row, j] == 0.0) | (wall.simplices[facet] == corners[row, j, None]).any(axis=1)
    away = np.abs(np.sum(wall.normals[facet] * found.offsets[row], axis=1))
    height = np.zeros(len(corners))
    np.maximum.at(height, row[meets], away[meets])
    return height


def _crowded(
    points: Floats,
    facets: Mapping[str, Integers],
    patches: Mapping[str, Patch],
    wall: MovingWall,
    found: LayerNodes,
    own: Integers,
    share: float,
) -> Marks:
    """(l,) nodes too near to another boundary; ``own`` (l,) is the nearest facet of the wall for each node."""
    boundary = as_simplices(of_one_width(facets))
    walls = marks_at(len(points), wall.nodes)
    others = boundary[~walls[boundary].all(axis=1)]
    slides = marks_at(len(points), nodes_with(patches, SLIDING_ROLES))[others].all(axis=1)
    body = wall.bodies
    crowded = _too_near(points, points[others[~slides]], found, share)
    crowded |= _too_near(points, points[others[slides]], found, share, facing=_FACING)
    for label in range(int(body.max(initial=0)) + 1 if body.any() else 0):
        rows = body[own] == label
        crowded[rows] |= _too_near(points, wall.reference[wall.simplices[body != label]], found.chosen(rows), share)
    return crowded


def _too_near(points: Floats, corners: Floats, found: LayerNodes, share: float, facing: float | None = None) -> Marks:
    """(l,) nodes farther from the wall than a share of their distance to facets with corners (f, d, d)."""
    distance, nodes = np.linalg.norm(found.offsets, axis=1), points[found.nodes]
    places, facets = nearest_within(corners, nodes, float(distance.max(initial=0.0)) / share)
    away = np.where(facets[:, None] >= 0, places - nodes, np.inf)
    gap = np.linalg.norm(away, axis=1)
    too_near = distance > share * gap
    if facing is not None:
        near = np.flatnonzero(too_near)
        along = -np.sum(away[near] * found.offsets[near], axis=1)
        too_near[near] = along < facing * gap[near] * distance[near]
    return np.asarray(too_near)
