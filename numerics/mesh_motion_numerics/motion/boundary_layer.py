"""Boundary layers that move with their wall: their distance and direction to the wall stay as in the reference mesh.

Each node x of the layer belongs to a place p = Σ b_j x_j of the reference wall: the foot of its column where layers of
cells are stacked (:mod:`.boundary_layer_stacks`), otherwise the nearest place. The node goes to::

    x' = p' + s t / |t|,      p' = Σ b_j x_j',      t = Σ b_j G_j (x − p)
    s = (1 − a) |x − p| + a Σ b_j |G_j (x − p)|

with the wall's nodes at x_j' and their deformations G_j (:mod:`.boundary_layer_wall`). The share a is 0 where the wall
is smooth or has blunt edges: the node's distance from p is kept. It is 1 where x − p is nearly in the plane of the
facets, at a sharp edge: if the wall is stretched or sheared there, a kept distance would shear the cells by a multiple
of their height. Nodes above each other stay on one line, and a wall that moves rigidly carries its layer rigidly. All
positions are computed from the reference mesh: there is no drift.

The other nodes are interpolated, but not from the wall: the layer's outermost nodes shield it. They replace the wall's
nodes behind them as control points, so the system does not grow, and inner nodes need no evaluation. Where there is no
layer, the wall's own nodes remain control points.

References
----------
E. Luke, E. Collins, E. Blades, "A fast mesh deformation method using explicit interpolation", J. Comput. Phys. 231
(2012) 586–601: rigid motions of the boundary nodes, blended in the whole volume.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_numerics.mesh.boundary_layer_nodes import LayerNodes, first_row, furthest, layer_nodes
from mesh_motion_numerics.mesh.boundary_layer_wall import MovingWall
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.points import marks_at
from mesh_motion_numerics.mesh.roles import BoundaryRoles, Patch
from mesh_motion_numerics.mesh.sliding import SlidingSurfaces

_SHARP, _BLUNT = 0.25, 0.5  # mean cos² between an edge and its facets' normals where a is 1 and 0
_SPOILED = 0.2  # share of a cell's quality at rest below which no correction can repair it


class Shield(NamedTuple):
    """The layer's outermost nodes (e,), and the wall's nodes (s,) whose cells are all behind them."""

    outermost: Integers
    behind: Integers

    def instead(self, controls: Integers) -> Integers:
        """The control nodes (c,), in which the outermost nodes replace the wall's nodes behind them."""
        if not len(self.outermost):
            return controls
        return np.union1d(np.setdiff1d(controls, self.behind), self.outermost)


@dataclass(frozen=True, eq=False)
class BoundaryLayer:
    """The layer of a mesh's moving walls."""

    points: Floats  # (n, d), mesh length unit. Reference coordinates
    cells: CellTable
    prescribed: Marks  # (n,) bool. Moving and fixed nodes
    wall: MovingWall
    tied: LayerNodes
    sliding: SlidingSurfaces | None  # the surfaces of the layer's sliding nodes; None without such nodes
    shield: Shield

    @classmethod
    def build(
        cls,
        points: Floats,
        cells: CellTable,
        patches: Mapping[str, Patch],
        *,
        thickness: float | None,
        sliding: SlidingSurfaces | None = None,
        facets: Mapping[str, Integers] | None = None,
    ) -> BoundaryLayer | None:
        """The layer of a checked mesh with reference coordinates ``points`` (n, d); None if no node belongs to it.

        Without a ``thickness``, mesh length unit, it is the first cells at bodies (:func:`.first_row`).
        ``facets`` (f, k), of the whole boundary by type, are needed if ``cells`` are only the cells near the wall.
        """
        facets = boundary_facets(cells) if facets is None else facets
        wall = MovingWall.of_patches(points, facets, patches)
        if wall is None:
            return None
        prescribed = marks_at(len(points), BoundaryRoles.from_patches(patches).prescribed)
        where = points, cells, facets, patches, wall
        tied = first_row(*where) if thickness is None else layer_nodes(*where, thickness)
        heights = np.zeros(len(wall.nodes))
        distances = np.where(tied.places.weights > 0.0, np.linalg.norm(tied.offsets, axis=1)[:, None], 0.0)
        np.maximum.at(heights, tied.places.corners, distances)
        wall = replace(wall, heights=heights)
        empty = np.empty(0, dtype=np.int64)
        full = cls(points, cells, prescribed, wall, tied, sliding, Shield(empty, empty))
        return full.without(np.zeros(len(points), dtype=bool))

    @property
    def nodes(self) -> Integers:
        """(l,) nodes of the layer, ascending."""
        return self.tied.nodes

    @property
    def reach(self) -> float:
        """Upper limit for the distance of the layer's nodes from the wall, mesh length unit."""
        places, _ = self.wall.closest(self.points[self.nodes])  # a foot of a column may be farther away
        distances = np.linalg.norm(self.points[self.nodes] - places.of(self.wall.reference), axis=1)
        return furthest(float(distances.max()), 1)

    @cached_property
    def known(self) -> Marks:
        """(n,) nodes whose positions follow from the moving nodes alone: moving nodes, fixed nodes and the layer."""
        return self.prescribed | marks_at(len(self.points), self.nodes)

    def carried(self, moved: Floats) -> Floats:
        """(l, d) new positions of the layer's nodes, with the moving nodes at their rows of ``moved`` (n, d)."""
        out = self.lifted(moved)
        if self.sliding is not None:
            rows = np.searchsorted(self.nodes, self.sliding.nodes)
            out[rows] = self.sliding.project(out[rows])
        return out

    def lifted(self, moved: Floats) -> Floats:
        """The same, before the layer's sliding nodes are put onto their walls."""
        wall = moved[self.wall.nodes]
        corners, weights = self.tied.places
        turned = np.einsum("ljab,lb->lja", self.wall.deformations(wall)[corners], self.tied.offsets)
        mean = np.einsum("lj,lja->la", weights, turned)
        length = np.linalg.norm(mean, axis=1, keepdims=True)
        distance = self.distances(turned)[:, None]
        scale = np.divide(distance, length, out=np.zeros_like(length), where=length > 0.0)
        return np.asarray(self.tied.places.of(wall) + scale * mean)

    def distances(self, turned: Floats) -> Floats:
        """(l,) s, with the products G_j (x − p) (l, d, d)."""
        kept = np.linalg.norm(self.tied.offsets, axis=1)
        stretched = np.einsum("lj,lj->l", self.tied.places.weights, np.linalg.norm(turned, axis=2))
        return np.asarray((1.0 - self.follows) * kept + self.follows * stretched)

    @cached_property
    def follows(self) -> Floats:
        """(l,) a: the share by which the nodes' distances follow the wall's deformation."""
        (corners, weights), offsets = self.tied.places, self.tied.offsets
        height = np.einsum("lj,la,ljab,lb->l", weights, offsets, self.wall.mean_projections[corners], offsets)
        cosine2 = height / np.maximum(np.sum(offsets * offsets, axis=1), np.finfo(float).tiny)
        return np.asarray(np.clip((_BLUNT - cosine2) / (_BLUNT - _SHARP), 0.0, 1.0))

    def without(self, released: Marks) -> BoundaryLayer | None:
        """The layer without the released (n,) nodes; None if none is left."""
        tied = self.tied.chosen(~released[self.nodes])
        if not len(tied.nodes):
            return None
        sliding = None if self.sliding is None else self.sliding.of(np.isin(self.sliding.nodes, tied.nodes))
        sliding = sliding if sliding is not None and len(sliding.nodes) else None
        rest = replace(self, tied=tied, sliding=sliding)
        return replace(rest, shield=_shield(self.cells, rest.known, self.wall.nodes, tied.nodes))

    def fitting(
        self, moved: Floats, quality: Callable[[Floats, Integers], Floats], valid: Floats | None = None
    ) -> BoundaryLayer | None:
        """The layer without the cells that it would spoil by itself, for example in concave corners that close.

        Parameters
        ----------
        moved : (n, d) array, mesh length unit
            The moving nodes at their targets, all others as in the reference mesh.
        quality : callable
            Positions (n, d) and numbers of cells (k,) → their metric (k,).
        valid : (n, d) array, mesh length unit, optional
            A valid mesh from which a correction will begin: nodes with another position in it leave the layer.
        """
        trial = moved.copy()
        trial[self.nodes] = self.carried(moved)
        if valid is not None:
            away = (valid != trial).any(axis=1)
            return self.without(away) if away[self.nodes].any() else self
        inside = np.flatnonzero(self.cells.within(self.known))
        spoiled = inside[~(quality(trial, inside) > _SPOILED * quality(self.points, inside))]
        if not len(spoiled):
            return self
        return self.without(
            marks_at(len(self.points), *(block.nodes[rows] for block, _, rows in self.cells.located(spoiled)))
        )


def _shield(cells: CellTable, known: Marks, wall: Integers, layer: Integers) -> Shield:
    """The layer's nodes in cells with a node outside ``known`` (n,), and the wall's nodes that are in no such cell."""
    outside = marks_at(len(known), *(block.nodes[~known[block.nodes].all(axis=1)] for block in cells))
    return Shield(layer[outside[layer]], wall[~outside[wall]])
