"""Layers of thin cells on the moving walls: their places in a mesh, and whether a motion would spoil them.

A wall is layered where its cells are much longer than high, in every direction along the wall. Interpolation alone
preserves such cells where other boundaries are far away. In a narrow passage the field changes so fast near the wall
that the cells lean over and change their height. Then the layer moves with its wall (:mod:`.boundary_layer`); its
thickness is the height of the thin cells, at most their length.

Without thin cells, a motion that is a function of the boundary carries the first cells at plane bodies instead.
Interpolation knows no points inside a body: if a circle in even triangles turns by 45°, its first cells turn by 26°
against the wall and change their height by 30 %; carried ones by 2.2° and 4 %, and the smallest shape of all cells is
the same to 0.01. In 3D the shape would pay for it: a wing that turns by 30° keeps 0.48 of its quality, not 0.51.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers, Marks, Shorts
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_numerics.mesh.boundary_layer_nodes import furthest
from mesh_motion_numerics.mesh.boundary_layer_wall import MovingWall
from mesh_motion_numerics.mesh.cells import CellBlock, CellTable
from mesh_motion_numerics.mesh.points import marks_at
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.mesh.sliding import SlidingSurfaces
from mesh_motion_numerics.motion.boundary_layer import BoundaryLayer

#: Smallest ratio of the edges along the wall to the height of a thin cell.
_THIN = 5.0
#: Smallest share of a layered wall's nodes that have thin cells above them.
_LAYERED = 0.3
#: Largest change of a first edge's length, and largest turn against the wall in radians, that a motion may cause.
_STRETCH, _TURN = 0.005, 0.008
#: Percentile of the heights of the thin cells above layered nodes, and of the edges along the wall: the smaller is
#: used.
_HEIGHT = 25.0
_MOST_LAYERS = 200


@dataclass(frozen=True, eq=False)
class LayeredWalls:
    """The layered moving walls of a mesh, or those at which the first cells are carried."""

    points: Floats  # (n, d), mesh length unit. Reference coordinates
    cells: CellTable
    facets: Mapping[str, Integers]
    patches: Mapping[str, Patch]
    sliding: SlidingSurfaces | None
    wall: MovingWall
    rows: Integers  # (k,). Layered nodes, as rows of the wall's nodes; none if the first cells are carried
    #: (k,). The node at the other end of each node's first edge, which is the shortest edge that leaves the wall.
    above: Integers
    along: Floats  # (n,), mesh length unit. Shortest edge along the wall at each of its nodes

    @classmethod
    def build(
        cls,
        points: Floats,
        cells: CellTable,
        patches: Mapping[str, Patch],
        sliding: SlidingSurfaces | None,
        facets: Mapping[str, Integers] | None = None,
        *,
        first_cells: bool = False,
    ) -> LayeredWalls | None:
        """Build them for a checked mesh; None if no moving wall has layers, and no ``first_cells`` in 2D are wanted.

        ``facets`` (f, k), of the whole boundary by type, are needed if ``cells`` are only the cells near the walls.
        """
        facets = boundary_facets(cells) if facets is None else facets
        wall = MovingWall.of_patches(points, facets, patches)
        if wall is None:
            return None
        on_wall = marks_at(len(points), wall.nodes)
        above, height, along = _first_edges(points, cells, on_wall)
        layered = height[wall.nodes] * _THIN < along[wall.nodes]
        if np.count_nonzero(layered) < _LAYERED * len(wall.nodes):
            if not first_cells or points.shape[1] != 2:
                return None
            layered[:] = False
        rows = np.flatnonzero(layered)
        return cls(points, cells, facets, patches, sliding, wall, rows, above[wall.nodes[rows]], along)

    @property
    def thin(self) -> bool:
        """Whether the cells are thin, so that a motion may spoil them."""
        return len(self.rows) > 0

    def spoiled_by(self, moved: Floats) -> bool:
        """Whether at positions (n, d) a first edge has changed its length or direction by more than allowed."""
        feet = self.wall.nodes[self.rows]
        turned = self.wall.deformations(moved[self.wall.nodes])[self.rows]
        before = np.einsum("kij,kj->ki", turned, self.points[self.above] - self.points[feet])
        now = moved[self.above] - moved[feet]
        length, own = np.linalg.norm(before, axis=1), np.linalg.norm(now, axis=1)
        if np.any(np.abs(own - length) > _STRETCH * length):
            return True
        return bool(np.any(np.linalg.norm(now / own[:, None] - before / length[:, None], axis=1) > _TURN))

    @cached_property
    def layer(self) -> BoundaryLayer | None:
        """The layer that moves with the walls."""
        thickness = self._thickness() if self.thin else None
        return BoundaryLayer.build(
            self.points, self.cells, self.patches, thickness=thickness, sliding=self.sliding, facets=self.facets
        )

    @property
    def reach(self) -> float:
        """Upper limit for the distance of a layer's nodes from the wall, without their cells; mesh length unit."""
        if not self.thin:
            return 0.0 if self.layer is None else self.layer.reach
        along = np.percentile(self.along[self.wall.nodes[self.rows]], _HEIGHT, method="nearest")
        return furthest(float(along), self.points.shape[1])

    def _thickness(self) -> float:
        """Height of the thin cells above most layered nodes, at most one edge along the wall; mesh length unit."""
        foot = np.full(len(self.points), -1)
        foot[self.wall.nodes] = self.wall.nodes
        blocks = [(block.nodes, _shortest(self.points, block)) for block in self.cells]
        for _ in range(_MOST_LAYERS):
            before = foot.copy()
            for nodes, shortest in blocks:
                reached = before[nodes] >= 0
                rows = np.flatnonzero(reached.any(axis=1) & ~reached.all(axis=1))
                below = before[nodes[rows, np.argmax(reached[rows], axis=1)]]
                thin = _THIN * shortest[rows] < self.along[below]
                for column in nodes[rows[thin]].T:
                    new = foot[column] < 0
                    foot[column[new]] = below[thin][new]
            if np.array_equal(foot, before):
                break
        off = np.flatnonzero((foot >= 0) & (foot != np.arange(len(foot))))
        height = np.zeros(len(self.points))
        np.maximum.at(height, foot[off], np.linalg.norm(self.points[off] - self.points[foot[off]], axis=1))
        feet = self.wall.nodes[self.rows]
        own, along = (np.percentile(of[feet], _HEIGHT, method="nearest") for of in (height, self.along))
        return float(min(own, along))


def _edges(block: CellBlock) -> Integers:
    """(e, 2) local ends of the edges of a cell type."""
    corners = block.type.corner_array
    if block.type.is_simplex:
        k = block.type.n_nodes
        return np.array([(a, b) for a in range(k) for b in range(a)], dtype=np.int64)
    ends = np.concatenate([corners[:, [0, j]] for j in range(1, corners.shape[1])])
    return np.unique(np.sort(ends, axis=1), axis=0)


def _shortest(points: Floats, block: CellBlock) -> Floats:
    """(m,) length of the shortest edge of each cell."""
    return np.asarray(np.sqrt(np.min([_squares(points, block.nodes[:, ends]) for ends in _edges(block)], axis=0)))


def _squares(points: Floats, ends: Shorts) -> Floats:
    """(m,) squared length of edges (m, 2)."""
    edge = points[ends[:, 1]] - points[ends[:, 0]]
    return np.asarray(np.sum(edge * edge, axis=1))


def _first_edges(points: Floats, cells: CellTable, on_wall: Marks) -> tuple[Integers, Floats, Floats]:
    """For each node on the wall: end and length of its shortest edge off the wall, length of the shortest along it."""
    above, height = np.full(len(points), -1), np.full(len(points), np.inf)
    along = np.full(len(points), np.inf)
    for block in cells:
        nodes = block.nodes[on_wall[block.nodes].any(axis=1)]
        for ends in _edges(block):
            pairs = nodes[:, ends]
            length = np.sqrt(_squares(points, pairs))
            both = on_wall[pairs].all(axis=1)
            for a, b in ((0, 1), (1, 0)):
                np.minimum.at(along, pairs[both, a], length[both])
                off = on_wall[pairs[:, a]] & ~on_wall[pairs[:, b]]
                order = np.lexsort((pairs[off, b], length[off]))[::-1]  # written last, so the shortest remains
                shorter = length[off][order] <= height[pairs[off, a][order]]
                chosen = order[shorter]
                height[pairs[off, a][chosen]] = length[off][chosen]
                above[pairs[off, a][chosen]] = pairs[off, b][chosen]
    return above, height, along
