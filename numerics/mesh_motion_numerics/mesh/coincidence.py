"""Points at the same place: duplicate nodes of a wake, or of the two sides of an interface or a baffle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.neighbours import connected
from mesh_motion_numerics.mesh.points import bounding_box, marks_at
from mesh_motion_numerics.mesh.smooth_pieces import area_vectors, of_one_width

# rounding of coordinates, relative to the extent
_SAME_PLACE = 1e-13
#: Two sides pass through each other if they move towards each other at less than 60° to their common normal.
_TOWARDS = 0.5


def first_at_place(points: Floats, extent: float, tolerance: float = _SAME_PLACE) -> Integers:
    """For each point the lowest number of the points closer than the tolerance, directly or through a chain.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    extent : float, mesh length unit
    tolerance : float
        As a share of the extent.

    Returns
    -------
    (n,) int64 array
    """
    place = np.arange(len(points))
    order = np.lexsort(points.T)  # identical points first: a tree of many identical points takes quadratic time
    same = np.r_[False, (points[order[1:]] == points[order[:-1]]).all(axis=1)]
    place[order] = np.minimum.reduceat(order, np.flatnonzero(~same))[np.cumsum(~same) - 1]
    distinct = np.flatnonzero(place == np.arange(len(points)))
    a, b = cKDTree(points[distinct]).query_pairs(tolerance * extent, output_type="ndarray").T
    if not len(a):
        return place
    group = connected(len(distinct), a, b)
    first = np.full(group.max() + 1, len(points))
    np.minimum.at(first, group, distinct)
    return np.asarray(first[group][np.searchsorted(distinct, place)])


def coincident_nodes(points: Floats, nodes: Integers) -> Integers:
    """(c, 2) pairs of the nodes (b,), ascending, at one place of ``points`` (n, d): the first one, and another one."""
    first = nodes[first_at_place(points[nodes], float(np.ptp(bounding_box(points[nodes]), axis=0).max()))]
    others = first != nodes
    return np.column_stack([first[others], nodes[others]])


def met_nodes(reference: Floats, points: Floats, nodes: Integers) -> Integers:
    """(c, 2) pairs of the nodes (b,), ascending, at one place in ``points`` (n, d), but not in ``reference`` (n, d)."""
    extent = float(np.ptp(bounding_box(reference), axis=0).max())
    first = nodes[first_at_place(points[nodes], extent)]
    apart = np.abs(reference[first] - reference[nodes]).max(axis=1) > _SAME_PLACE * extent
    return np.column_stack([first[apart], nodes[apart]])


def linked_by_cells(cells: CellTable, pairs: Integers, count: int) -> Marks:
    """(c,) whether the nodes of each of the pairs (c, 2), of a mesh with ``count`` nodes, are in one cell."""
    named, keys, found = marks_at(count, pairs), np.sort(pairs, axis=1) @ [count, 1], []
    for block in cells if len(pairs) else ():
        few = np.sort(block.nodes[named[block.nodes].sum(axis=1) > 1].astype(np.int64), axis=1)
        found += [few[:, a] * count + few[:, b] for a, b in combinations(range(few.shape[1]), 2)]
    return np.isin(keys, np.concatenate(found)) if found else np.zeros(len(pairs), dtype=bool)


@dataclass(frozen=True, eq=False)
class CoincidentSides:
    """The nodes of the two sides of an interface or a baffle, in pairs at the same place."""

    #: (c, 2). Places with more nodes are left out: sides that meet in one point only may slide past each other.
    pairs: Integers
    facets: Integers  # (f, w). The boundary facets with such a node, as :func:`of_one_width` gives them

    @classmethod
    def build(cls, pairs: Integers, facets: Mapping[str, Integers], known: Marks) -> CoincidentSides:
        """Build them from pairs (c, 2) of coincident nodes, boundary facets, and nodes (n,) with known places."""
        alone = np.bincount(pairs[:, 0], minlength=len(known))[pairs[:, 0]] == 1
        pairs = pairs[alone & known[pairs].all(axis=1)]
        if not len(pairs) or "vertex" in facets:
            return cls(pairs[:0], np.empty((0, 2), dtype=np.int64))
        rows = of_one_width(facets)
        return cls(pairs, rows[np.isin(rows, pairs).any(axis=1)])

    def passing(self, points: Floats) -> tuple[int, int] | None:
        """The first pair of nodes that have passed through each other at ``points`` (n, d); None if there is none."""
        normals = np.zeros_like(points)
        areas = area_vectors(points, self.facets)
        for column in self.facets.T:
            np.add.at(normals, column[column >= 0], areas[column >= 0])
        one, other = self.pairs.T
        normal, apart = normals[one] - normals[other], points[other] - points[one]
        depth = -np.sum(normal * apart, axis=1)
        length = np.linalg.norm(normal, axis=1) * np.linalg.norm(apart, axis=1)
        least = _SAME_PLACE * float(np.ptp(bounding_box(points), axis=0).max())
        through = (depth > _TOWARDS * length) & (np.linalg.norm(apart, axis=1) > 1e3 * least)
        if not through.any():
            return None
        first = int(np.argmax(through))
        return int(one[first]), int(other[first])
