"""Detects a moved boundary that crosses itself: then no valid mesh exists, and none needs to be searched for.

Two facets cross if an edge of one goes through the other: its ends are strictly on both sides, and it passes strictly
inside (signs of areas in 2D, of volumes in 3D) or, in 3D, through an edge: where opposite walls are meshed alike, edge
meets edge. Facets that share a node, and ends that only touch, are ignored. A quad is two triangles; as its diagonal is
arbitrary, an edge must go through it with either diagonal.

Only facets near a moving one are tested: they are sorted into classes of about equal size, with a k-d tree each.

References
----------
T. Möller, B. Trumbore, "Fast, minimum storage ray/triangle intersection", J. Graphics Tools 2 (1997) 21–28.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from mesh_motion_server.numerics.arrays import Floats, Integers, Marks

__all__ = ["BoundaryFacets", "crossing_place"]


#: Below this share of the product of lengths, the sign of an area or a volume is not certain.
_FLAT = 1e-12
_SIDES = {"line": ((0, 1),), "triangle": ((0, 1), (1, 2), (2, 0)), "quad": ((0, 1), (1, 2), (2, 3), (3, 0))}
#: The triangles of a facet, for each choice of a diagonal.
_SPLITS = {
    "line": (((0, 1),),),
    "triangle": (((0, 1, 2),),),
    "quad": (((0, 1, 2), (0, 2, 3)), ((0, 1, 3), (1, 2, 3))),
}


@dataclass(frozen=True, eq=False)
class BoundaryFacets:
    """The facets whose nodes all have prescribed positions.

    Attributes
    ----------
    nodes : dict of (f, k) int64 arrays
        By type of facet.
    moving : (n,) bool array
        Nodes that move.
    """

    nodes: dict[str, Integers]
    moving: Marks

    @classmethod
    def build(cls, facets: Mapping[str, Integers], moving: Integers, fixed: Integers, count: int) -> BoundaryFacets:
        """From the boundary facets of a mesh of ``count`` nodes, and its moving and fixed nodes; not in 1D."""
        moves, prescribed = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
        moves[moving] = prescribed[moving] = prescribed[fixed] = True
        chosen = {name: nodes[prescribed[nodes].all(axis=1)] for name, nodes in facets.items() if name in _SIDES}
        return cls({name: nodes for name, nodes in chosen.items() if len(nodes)}, moves)


def crossing_place(boundary: BoundaryFacets, points: Floats) -> Floats | None:
    """A place (d,) where the boundary crosses itself with the nodes at ``points`` (n, d), None if there is none."""
    for name, nodes in boundary.nodes.items():
        for other, others in boundary.nodes.items():
            place = _crossing(points, boundary.moving, (name, nodes), (other, others))
            if place is not None:
                return place
    return None


def _crossing(points: Floats, moving: Marks, ones: tuple[str, Integers], others: tuple[str, Integers]) -> Floats | None:
    """A place where an edge of one kind of facet goes through another kind; one of the two facets moves."""
    for a, b in ((ones, others), (others, ones)):  # a's moving facets with all of b
        rows = np.flatnonzero(moving[a[1]].any(axis=1))
        first, second = _near(points, a[1][rows], b[1])
        edges, faces = (a[1][rows[first]], b[1][second]) if a is ones else (b[1][second], a[1][rows[first]])
        shared = (edges[:, :, None] == faces[:, None, :]).any(axis=(1, 2))
        edges, faces = edges[~shared], faces[~shared]
        for side in _SIDES[ones[0]]:
            ends = points[edges[:, side]]
            through = _goes_through(ends, points, faces, others[0])
            if through.any():
                place: Floats = ends[int(np.argmax(through))].mean(axis=0)
                return place
    return None


def _near(points: Floats, ones: Integers, others: Integers) -> tuple[Integers, Integers]:
    """Pairs (p,) of facets whose bounding circles or spheres, and boxes, intersect."""
    centres, radii = _circles(points, ones)
    other_centres, other_radii = _circles(points, others)
    pairs = [np.empty((0, 2), dtype=np.int64)]
    classes = np.floor(np.log2(np.maximum(other_radii, np.finfo(float).tiny)))
    for size in np.unique(classes):
        members = np.flatnonzero(classes == size)
        tree = cKDTree(other_centres[members])
        found = tree.query_ball_point(centres, radii + other_radii[members].max())
        counts = np.array([len(hits) for hits in found], dtype=np.int64)
        if counts.any():
            hits = np.concatenate([np.sort(np.array(h, dtype=np.int64)) for h in found if h])
            pairs.append(np.column_stack([np.repeat(np.arange(len(ones)), counts), members[hits]]))
    first, second = np.concatenate(pairs).T
    low, high, other_low, other_high = (
        end(points[facets], axis=1) for facets in (ones, others) for end in (np.min, np.max)
    )
    meet = ((low[first] <= other_high[second]) & (high[first] >= other_low[second])).all(axis=1)
    return first[meet], second[meet]


def _circles(points: Floats, facets: Integers) -> tuple[Floats, Floats]:
    """Centres (f, d) and radii (f,) of circles or spheres around facets (f, k)."""
    corners = points[facets]
    centres = corners.mean(axis=1)
    return centres, np.sqrt(np.max(np.sum((corners - centres[:, None]) ** 2, axis=2), axis=1))


def _goes_through(ends: Floats, points: Floats, faces: Integers, kind: str) -> Marks:
    """Whether edges with ends (p, 2, d) go through facets (p, k) with either diagonal."""
    found = np.ones(len(ends), dtype=bool)
    for split in _SPLITS[kind]:
        parts = [_pierces(ends, points[faces[:, part]]) for part in split]
        found &= np.logical_or.reduce(parts)
    return found


def _pierces(ends: Floats, simplices: Floats) -> Marks:
    """Whether edges with ends (p, 2, d) go through simplices (p, d, d): a segment in 2D, a triangle in 3D."""
    d = ends.shape[2]
    below, above = (_signed(np.concatenate([simplices, end[:, None]], axis=1)) for end in (ends[:, 0], ends[:, 1]))
    through: Marks = below * above < 0
    ends, simplices = ends[through], simplices[through]
    inside = np.stack(
        [
            _signed(np.concatenate([ends, np.delete(simplices, corner, axis=1)], axis=1)) * (-1) ** corner
            for corner in range(d)
        ]
    )
    certain = np.count_nonzero(inside, axis=0)
    through[through] = (np.abs(inside.sum(axis=0)) == certain) & (certain >= 2)  # one 0 of a triangle: through its edge
    return through


def _signed(corners: Floats) -> Floats:
    """The sign (p,) of the area or volume of simplices (p, d + 1, d); 0 where it is not certain."""
    edges = corners[:, 1:] - corners[:, :1]
    determinants = np.linalg.det(edges)
    certain = np.abs(determinants) > _FLAT * np.prod(np.sqrt(np.sum(edges * edges, axis=2)), axis=1)
    signs: Floats = np.where(certain, np.sign(determinants), 0.0)
    return signs
