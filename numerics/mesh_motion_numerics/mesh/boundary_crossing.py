"""Detects a moved boundary that crosses itself: then no valid mesh exists, and no search for one is needed.

Two facets cross if an edge of one goes through the other: its ends are strictly on both sides, and it passes strictly
inside (signs of areas in 2D, of volumes in 3D) or, in 3D, through an edge, because the edges of opposite walls with
equal meshes can meet. A quad is two triangles; as its diagonal is arbitrary, an edge must go through it with either
diagonal.

Two facets in one plane (one line in 2D) that overlap cross too if they face the same way: the cells behind both would
fill the same place. Facets that face each other do not cross: they are the sides of a baffle, or of an interface.

Facets that only touch, in a node, an edge or a face, may have crossed as well, but the signs do not show it:
:func:`touching_facets` finds them for another test. Facets that share a node are ignored.

Only facets near a moving one are tested, if no plane parallel to one of both facets lies between them.

References
----------
T. Möller, B. Trumbore, "Fast, minimum storage ray/triangle intersection", J. Graphics Tools 2 (1997) 21–28.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.morton import morton_codes
from mesh_motion_numerics.mesh.points import bounding_box, marks_at
from mesh_motion_numerics.mesh.smooth_pieces import area_vectors, of_one_width, widened

#: Below this share of the product of lengths, the sign of an area or a volume is not certain …
_FLAT = 1e-12
#: … nor if it changes when coordinates change by this many of their roundings.
_ROUNDINGS = 8.0 * np.finfo(float).eps
#: Facets in one plane overlap if the overlap is more than this share of their size.
_OVERLAP = 1e-9
#: Directions of shifts that are parallel to no axis, and their length, relative to the mesh.
_SHIFTS = np.array([(0.83, 0.31, 0.47), (-0.57, 0.53, 0.63), (-0.13, -0.77, 0.61)])
_SHIFT = 1e-7
#: Number of pairs of facets that are tested at once: for a single pair, the overhead of each step would dominate.
_TOGETHER = 1024
_SIDES = {"line": ((0, 1),), "triangle": ((0, 1), (1, 2), (2, 0)), "quad": ((0, 1), (1, 2), (2, 3), (3, 0))}
#: The triangles of a facet, for each choice of a diagonal.
_SPLITS = {
    "line": (((0, 1),),),
    "triangle": (((0, 1, 2),),),
    "quad": (((0, 1, 2), (0, 2, 3)), ((0, 1, 3), (1, 2, 3))),
}


@dataclass(frozen=True, eq=False)
class BoundaryFacets:
    """The facets whose nodes all have prescribed positions."""

    nodes: dict[str, Integers]  # (f, k) each. The facets by type
    moving: Marks  # (n,) bool. Nodes that move
    _ordered: list[tuple[Integers, NDArray[np.int32], Marks]] = field(default_factory=list, init=False)  # by in_order

    @classmethod
    def build(cls, facets: Mapping[str, Integers], moving: Integers, fixed: Integers, count: int) -> BoundaryFacets:
        """Build it from the boundary facets of a mesh of ``count`` nodes, and its moving and fixed nodes; not in 1D."""
        moves, prescribed = marks_at(count, moving), marks_at(count, moving, fixed)
        chosen = {name: nodes[prescribed[nodes].all(axis=1)] for name, nodes in facets.items() if name in _SIDES}
        return cls({name: nodes for name, nodes in chosen.items() if len(nodes)}, moves)

    def in_order(self, points: Floats) -> tuple[Integers, NDArray[np.int32], Marks]:
        """Numbers (f,) of all facets, neighbours next to each other; their nodes (f, w); and which facets (f,) move.

        The order is that of the first ``points`` (n, d): with any other one the search for pairs takes longer.
        """
        if not self._ordered:
            facets = of_one_width(self.nodes)
            order = np.argsort(morton_codes(points[facets[:, :2]].mean(axis=1)), kind="stable")
            moves = np.concatenate([self.moving[nodes].any(axis=1) for nodes in self.nodes.values()])
            self._ordered.append((order, facets[order].astype(np.int32), moves))
        return self._ordered[0]


NearFacets = Sequence[tuple[str, Integers, str, Integers]]
"""Pairs of near facets of two kinds, (p, k) and (p, l), without a common node; at least one facet of a pair moves."""


def crossing_place(boundary: BoundaryFacets, points: Floats, near: NearFacets | None = None) -> Floats | None:
    """A place (d,) where the boundary crosses itself with the nodes at ``points`` (n, d), None if there is none.

    ``near``: the result of :func:`near_facets`, if it is known.
    """
    for kind, edges, other, faces in near_facets(boundary, points) if near is None else near:
        found = _covers(points, edges, faces) | _goes_through(points, edges, kind, faces, other)
        if found.any():
            place: Floats = points[edges[int(np.argmax(found))]].mean(axis=0)
            return place
    return None


def straddling_place(boundary: BoundaryFacets, points: Floats, near: NearFacets | None = None) -> Floats | None:
    """The same as :func:`crossing_place` for facets that cross in their nodes: a place where they cross for every tiny
    common shift of the moving nodes. None if a shift separates them, or if the crossing is not certain.
    """
    place, near = None, near_facets(boundary, points) if near is None else near
    for direction in np.vstack([_SHIFTS, -_SHIFTS])[:, : points.shape[1]] * _shift(points):
        place = crossing_place(boundary, points + np.where(boundary.moving[:, None], direction, 0.0), near)
        if place is None:
            return None
    return place


def touching_facets(boundary: BoundaryFacets, points: Floats, near: NearFacets | None = None) -> Integers:
    """Facets (f, w), in the form of :class:`.smooth_pieces.Piece`, that touch another one, if one of the two moves."""
    width = 2 if points.shape[1] == 2 else 4
    rows = [np.empty((0, width), dtype=np.int64)]
    for kind, edges, other, faces in near_facets(boundary, points) if near is None else near:
        found = _goes_through(points, edges, kind, faces, other, touches=True)
        rows += [widened(edges[found], width), widened(faces[found], width)]
    return np.asarray(np.unique(np.concatenate(rows), axis=0))


def near_facets(boundary: BoundaryFacets, points: Floats) -> NearFacets:
    """The pairs of facets that may cross or touch with the nodes at ``points`` (n, d), or after a small shift."""
    found: list[tuple[str, Integers, str, Integers]] = []
    if not boundary.nodes:
        return found
    order, facets, moves = boundary.in_order(points)
    margin = 3.0 * _shift(points) + _rounding(points)
    rows = kernels.near_facets(np.ascontiguousarray(points), facets, moves[order], margin)
    pairs = np.sort(order[rows], axis=1)
    pairs = np.where(moves[pairs[:, :1]], pairs, pairs[:, ::-1])  # the first facet moves
    pairs = pairs[np.lexsort(pairs.T[::-1])]
    firsts = dict(zip(boundary.nodes, np.cumsum([0, *map(len, boundary.nodes.values())]), strict=False))
    for (kind, nodes), (other, others) in product(boundary.nodes.items(), repeat=2):
        one, two = (pairs - (firsts[kind], firsts[other])).T
        here = (one >= 0) & (one < len(nodes)) & (two >= 0) & (two < len(others))
        if here.any():
            ones, near = nodes[one[here]], others[two[here]]
            found += [(kind, ones, other, near), (other, near, kind, ones)]  # edges of each facet through the other
    return found


def _shift(points: Floats) -> float:
    """Length of a tiny shift."""
    return _SHIFT * float(np.ptp(bounding_box(points), axis=0).max())


def _rounding(points: Floats) -> float:
    """Largest effect of rounding on coordinates."""
    return _ROUNDINGS * float(np.abs(bounding_box(points)).max())


def _covers(points: Floats, ones: Integers, others: Integers) -> Marks:
    """Whether facets (p, k) and (p, l) lie in one plane, or line, face the same way and overlap."""
    a, b = points[ones], points[others]
    normals = [area_vectors(points, widened(facets, max(2, 4 * (a.shape[2] - 2)))) for facets in (ones, others)]
    sizes = [np.linalg.norm(np.ptp(corners, axis=1), axis=1) for corners in (a, b)]
    length = np.linalg.norm(normals[1], axis=1)
    unit = normals[1] / np.maximum(length, np.finfo(float).tiny)[:, None]
    heights = np.abs(np.einsum("pkd,pd->pk", a - b[:, :1], unit)).max(axis=1)
    flat = _FLAT * (sizes[0] + sizes[1]) + _rounding(points)
    found: Marks = (heights <= flat) & (np.sum(normals[0] * normals[1], axis=1) > 0.0) & (length > 0.0)
    a, b, unit = a[found], b[found], unit[found]
    least = _OVERLAP * np.minimum(*(size[found] for size in sizes))
    apart = np.zeros(len(a), dtype=bool)
    for axis in _axes(a, b, unit):
        low, high, other_low, other_high = (
            end(np.einsum("pkd,pd->pk", corners, axis), axis=1) for corners in (a, b) for end in (np.min, np.max)
        )
        apart |= (high - other_low <= least) | (other_high - low <= least)
    found[found] = ~apart
    return found


def _axes(a: Floats, b: Floats, normals: Floats) -> Iterator[Floats]:
    """Unit vectors (p, d) in the planes of facets (p, k, d) and (p, l, d); one separates facets that are apart."""
    if normals.shape[1] == 2:
        yield np.column_stack([-normals[:, 1], normals[:, 0]])
        return
    for corners in (a, b):
        for edge in np.moveaxis(np.roll(corners, -1, axis=1) - corners, 1, 0):
            across = np.cross(normals, edge)
            yield across / np.maximum(np.linalg.norm(across, axis=1), np.finfo(float).tiny)[:, None]


def _goes_through(
    points: Floats, ones: Integers, kind: str, faces: Integers, other: str, *, touches: bool = False
) -> Marks:
    """Whether a side of facets (p, k) goes through facets (p, l) with both diagonals; or may touch them with one."""
    sides, splits, rounding = np.array(_SIDES[kind]), np.array(_SPLITS[other]), _rounding(points)
    found = [np.empty(0, dtype=bool)]
    for begin in range(0, len(ones), _TOGETHER):
        rows = slice(begin, begin + _TOGETHER)
        edges, simplices = ones[rows][:, sides], faces[rows][:, splits]
        shape = (len(edges), len(sides), *splits.shape[:2])
        ends = np.broadcast_to(edges[:, :, None, None], (*shape, 2)).reshape(-1, 2)
        parts = np.broadcast_to(simplices[:, None], (*shape, splits.shape[2])).reshape(-1, splits.shape[2])
        pierced = _pierces(points[ends], points[parts], rounding, touches=touches).reshape(shape)
        of_splits = np.logical_or.reduce(pierced, axis=3)
        through = (np.logical_or if touches else np.logical_and).reduce(of_splits, axis=2)
        found.append(np.logical_or.reduce(through, axis=1))
    return np.concatenate(found)


def _pierces(ends: Floats, simplices: Floats, rounding: float, *, touches: bool) -> Marks:
    """Whether edges with ends (p, 2, d) go through simplices (p, d, d): a segment in 2D, a triangle in 3D."""
    d = ends.shape[2]
    below, above = (
        _signed(np.concatenate([simplices, end[:, None]], axis=1), rounding) for end in (ends[:, 0], ends[:, 1])
    )
    through: Marks = below * above < (0.5 if touches else 0.0)
    ends, simplices = ends[through], simplices[through]
    inside = np.stack(
        [
            _signed(np.concatenate([ends, np.delete(simplices, corner, axis=1)], axis=1), rounding) * (-1) ** corner
            for corner in range(d)
        ]
    )
    certain = np.count_nonzero(inside, axis=0)
    least = 0 if touches else 2  # one 0 for a triangle: through its edge
    through[through] = (np.abs(inside.sum(axis=0)) == certain) & (certain >= least)
    return through


def _signed(corners: Floats, rounding: float) -> Floats:
    """The sign (p,) of the area or volume of simplices (p, d + 1, d); 0 where it is not certain."""
    edges = corners[:, 1:] - corners[:, :1]
    determinants = np.linalg.det(edges)
    lengths = np.maximum(np.sqrt(np.sum(edges * edges, axis=2)), np.finfo(float).tiny)
    share = _FLAT + rounding / lengths.min(axis=1)
    certain = np.abs(determinants) > share * np.prod(lengths, axis=1)
    signs: Floats = np.where(certain, np.sign(determinants), 0.0)
    return signs
