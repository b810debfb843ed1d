"""A patch's boundary facets, cut into smooth pieces along its sharp edges.

A patch may be one side of a box, all of its sides, or a pipe with its ends: nodes slide over a smooth piece but must
not round a sharp edge. Facets that share a side and whose normals differ by less than 40° belong to one piece.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.neighbours import connected
from mesh_motion_numerics.mesh.points import marks_at

#: Edges with a larger angle are sharp: a circle of ten segments is still smooth, a hexagon is not.
SMOOTH_COSINE = float(np.cos(np.radians(40.0)))
#: A piece is planar if its nodes lie this close to a plane, relative to its extent (single-precision files give 1e-7).
_PLANAR = 1e-6
#: Normals this close to a coordinate axis are set to that axis: the coordinate then stays bitwise.
_AXIS = 1e-9


@dataclass(frozen=True, eq=False)
class Piece:
    """Facets without a sharp edge between them."""

    nodes: Integers  # (p,). Ascending
    facets: Integers  # (f, w). Node indices; w = 1 in 1D, 2 in 2D, 4 in 3D with −1 at the end of a triangle
    normal: Floats | None  # (d,). Unit normal if the piece is planar

    @property
    def simplices(self) -> Integers:
        """(s, 2) segments or (s, 3) triangles; a quad is two triangles."""
        return as_simplices(self.facets)

    def in_plane_of(self, other: Piece, points: Floats) -> bool:
        """Whether the pieces face the same way in one plane of the points (n, d)."""
        if self.normal is None or other.normal is None or float(self.normal @ other.normal) < 1.0 - _PLANAR**2:
            return False
        away = (points[other.nodes] - points[self.nodes[0]]) @ self.normal
        both = points[np.concatenate([self.nodes, other.nodes])]
        return bool(np.abs(away).max() <= _PLANAR * np.ptp(both, axis=0).max())

    def with_facets_of(self, other: Piece) -> Piece:
        """This piece together with another one in its plane."""
        facets = np.unique(np.concatenate([self.facets, other.facets]), axis=0)
        return Piece(np.union1d(self.nodes, other.nodes), facets, self.normal)


def as_simplices(rows: Integers) -> Integers:
    """(s, d) segments or triangles of facets (f, w) of one width: a quad is two triangles, which end with −1."""
    if rows.shape[1] < 4:
        return rows
    return np.concatenate([rows[:, :3], rows[rows[:, 3] >= 0][:, [0, 2, 3]]])


def smooth_pieces(points: Floats, facets: Mapping[str, Integers], nodes: Integers) -> list[Piece]:
    """Smooth pieces of the boundary facets that have all their nodes in a patch.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    facets : dict of (f, k) int64 arrays
        The facets of the whole boundary, with outward normals, by type.
    nodes : (p,) int64 array
        The patch's nodes.
    """
    inside = marks_at(len(points), nodes)
    width = {1: 1, 2: 2, 3: 4}[points.shape[1]]
    own = [widened(block[inside[block].all(axis=1)], width) for block in facets.values()]
    table = np.concatenate([np.empty((0, width), dtype=np.int64), *own])
    if not len(table):
        return []
    areas = area_vectors(points, table)
    labels = _components(table, areas)
    return list(_collect(points, table, areas, labels))


def sides(facets: Integers) -> tuple[Integers, Integers]:
    """Sides (s, 1 or 2) of the facets, nodes ascending, and the row of each side's facet.

    The sides of an edge are its nodes, those of a triangle or quad its edges; a vertex has none.
    """
    rows = np.arange(len(facets))
    if facets.shape[1] == 1:
        return np.empty((0, 1), dtype=np.int64), np.empty(0, dtype=np.int64)
    if facets.shape[1] == 2:
        return facets.reshape(-1, 1), np.repeat(rows, 2)
    last = np.where(facets[:, 3] >= 0, facets[:, 3], facets[:, 2])
    pairs = np.stack([facets[:, [0, 1]], facets[:, [1, 2]], facets[:, [2, 3]], np.column_stack([last, facets[:, 0]])])
    kept = (pairs >= 0).all(axis=2)
    return np.sort(pairs[kept], axis=1), np.broadcast_to(rows, kept.shape)[kept]


def widened(block: Integers, width: int) -> Integers:
    """Facets (f, k) filled up with −1 to (f, ``width``)."""
    out = np.full((len(block), width), -1, dtype=np.int64)
    out[:, : block.shape[1]] = block
    return out


def of_one_width(facets: Mapping[str, Integers]) -> Integers:
    """All facets in one array: (f, 2) in 2D, (f, 4) in 3D with −1 at the end of a triangle."""
    widest = max(nodes.shape[1] for nodes in facets.values())
    width = 4 if widest > 2 else 2
    return np.concatenate([widened(nodes, width) for nodes in facets.values()])


def all_marked(marks: Marks, facets: Integers) -> Marks:
    """(f,) whether all nodes of each of the facets (f, w) are among the marked (n,) ones; −1 is not a node."""
    return np.asarray((marks[facets] | (facets < 0)).all(axis=1))


def area_vectors(points: Floats, facets: Integers) -> Floats:
    """(f, d) outward normals times area (length in 2D, 1 in 1D) of facets (f, w) as in :class:`Piece`."""
    if facets.shape[1] == 1:
        return np.ones((len(facets), 1))
    if facets.shape[1] == 2:
        edge = points[facets[:, 1]] - points[facets[:, 0]]
        return np.column_stack([edge[:, 1], -edge[:, 0]])
    fourth = np.where(facets[:, 3] >= 0, facets[:, 3], facets[:, 0])
    diagonal = points[facets[:, 2]] - points[facets[:, 0]]
    other = points[fourth] - points[facets[:, 1]]
    areas: Floats = np.cross(diagonal, other) / 2.0
    return areas


def _components(facets: Integers, areas: Floats) -> Integers:
    """Label of each facet's smooth component."""
    keys, owners = sides(facets)
    order = np.lexsort(keys.T[::-1])
    keys, owners = keys[order], owners[order]
    adjacent = (keys[1:] == keys[:-1]).all(axis=1)
    a, b = owners[:-1][adjacent], owners[1:][adjacent]
    lengths = np.linalg.norm(areas, axis=1)
    smooth = np.einsum("ij,ij->i", areas[a], areas[b]) >= SMOOTH_COSINE * lengths[a] * lengths[b]
    return connected(len(facets), a[smooth], b[smooth])


def _collect(points: Floats, facets: Integers, areas: Floats, labels: Integers) -> Iterator[Piece]:
    """The pieces, by label."""
    for label in range(int(labels.max()) + 1):
        own = labels == label
        nodes = np.unique(facets[own])
        nodes = nodes[nodes >= 0]
        yield Piece(nodes, facets[own], _plane_normal(points[nodes], areas[own].sum(axis=0)))


def _plane_normal(points: Floats, area: Floats) -> Floats | None:
    """Unit normal of the plane through the points, if there is one."""
    length = float(np.linalg.norm(area))
    if length == 0.0:
        return None
    normal: Floats = area / length
    axis = int(np.argmax(np.abs(normal)))
    if 1.0 - abs(normal[axis]) < _AXIS**2 or np.all(np.abs(np.delete(normal, axis)) < _AXIS):
        normal = np.eye(len(normal))[axis]
    away = (points - points.mean(axis=0)) @ normal
    extent = float(np.max(points.max(axis=0) - points.min(axis=0)))
    return normal if len(normal) == 1 or np.max(np.abs(away)) <= _PLANAR * extent else None
