"""Detects parts of the boundary that meet in a point or along edges while the mesh is on one side of both.

Two bodies that meet in their corners cross nothing, and the winding number is right at every place off the contact.
But the cells at each corner fill all directions that its own facets leave to the mesh. If both corners have such
directions in common, the mesh overlaps itself. The two sides of a thin solid have no direction in common. The same
holds where a corner meets a facet or an edge of another part, and where edges meet.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.neighbours import parts_of
from mesh_motion_numerics.mesh.points import spread
from mesh_motion_numerics.mesh.smooth_pieces import area_vectors, as_simplices, of_one_width

#: Places closer than this share of the facets' coordinates or sizes are one place.
_SAME = 1e-13
#: Directions that differ by less than this are not certainly different.
_ALONG = 1e-6
#: Number of tested places, spread over all.
_MOST = 64


@dataclass(frozen=True, eq=False)
class _Star:
    """The directions that one connected part of the boundary leaves to the mesh at a place.

    rays : (c, d − 1, d) unit vectors; each row spans a cone of directions, one ray in 2D
    outward : (c, d) unit normals, out of the mesh
    """

    rays: Floats
    outward: Floats

    def holds(self, direction: Floats) -> bool:
        """Whether a direction (d,) is certainly inside the mesh of this part."""
        near = int(np.argmax(self.middles @ direction))
        inside = self.middles[near] - _ALONG * self.outward[near]
        if self._distance(direction) < 10.0 * _ALONG:
            return False
        # direction + t (inside − direction) = Σ weight · ray: counts how often the line to the mesh goes through the
        # part
        way = np.broadcast_to(direction - inside, (len(self.rays), 1, len(inside)))
        vectors = np.concatenate([self.rays, way], axis=1)
        vectors = vectors[np.abs(np.linalg.det(vectors)) > _ALONG**3]
        weights = np.linalg.solve(vectors.swapaxes(1, 2), direction[:, None])[:, :, 0]
        through = (weights > 0.0).all(axis=1) & (weights[:, -1] < 1.0)
        return bool(np.count_nonzero(through) % 2 == 0)

    @property
    def middles(self) -> Floats:
        """(c, d) the middle direction of each cone."""
        middles = self.rays.mean(axis=1)
        return np.asarray(middles / np.linalg.norm(middles, axis=1)[:, None])

    def _distance(self, direction: Floats) -> float:
        """Distance of a direction (d,) from the part's directions."""
        weights = np.einsum("cij,i->cj", np.linalg.pinv(self.rays), direction)
        off = np.linalg.norm(direction - np.einsum("ci,cij->cj", weights, self.rays), axis=1)
        return float(off[(weights > -_ALONG).all(axis=1)].min(initial=np.inf))


def meeting_place(facets: Mapping[str, Integers], touching: Integers, points: Floats) -> Floats | None:
    """The first place (d,) where parts of the boundary meet and the mesh would overlap itself, None if there is none.

    Parameters
    ----------
    facets : dict of (f, k) int64 arrays
        The whole boundary, pointing outwards, by type.
    touching : (t, w) int64 array
        The facets that touch others, as :func:`.touching_facets` gives them.
    points : (n, d) array, mesh length unit
    """
    if not len(touching):
        return None
    simplices, rows = as_simplices(of_one_width(facets)), as_simplices(touching)
    corners = points[rows]
    tolerance = _SAME * float(np.abs(corners).max())
    for place in _places(rows, points, tolerance):
        near = _contains(corners, place, tolerance)
        here = np.unique(rows[near])
        here = here[np.linalg.norm(points[here] - place, axis=1) <= tolerance]
        at = np.unique(np.concatenate([rows[near], simplices[np.isin(simplices, here).any(axis=1)]]), axis=0)
        stars = list(_stars(at, points, place, tolerance))
        if any(star.holds(middle) for star, other in permutations(stars, 2) for middle in other.middles):
            return place
    return None


def _places(rows: Integers, points: Floats, tolerance: float) -> Iterator[Floats]:
    """Places where simplices (t, d) may meet: their nodes and, in 3D, where their edges cross; some of many."""
    nodes = np.unique(rows)
    yield from points[spread(nodes, _MOST)]
    if rows.shape[1] == 2:
        return
    edges = np.sort(np.concatenate([rows[:, [0, 1]], rows[:, [1, 2]], rows[:, [2, 0]]]), axis=1)
    edges = spread(np.unique(edges, axis=0), _MOST)
    first, second = np.triu_indices(len(edges), 1)
    apart = ~(edges[first][:, :, None] == edges[second][:, None]).any(axis=(1, 2))
    one, other = points[edges[first[apart]]], points[edges[second[apart]]]
    a, b, between = one[:, 1] - one[:, 0], other[:, 1] - other[:, 0], other[:, 0] - one[:, 0]
    across = np.cross(a, b)
    square = np.sum(across * across, axis=1)
    slanted = square > (_ALONG**2) * np.sum(a * a, axis=1) * np.sum(b * b, axis=1)
    a, b, between, across, square = (v[slanted] for v in (a, b, between, across, square))
    s, t = (np.sum(np.cross(between, v) * across, axis=1) / square for v in (b, a))
    meet = (s > 0.0) & (s < 1.0) & (t > 0.0) & (t < 1.0)
    meet &= np.abs(np.sum(between * across, axis=1)) <= tolerance * np.sqrt(square)
    yield from (one[slanted, 0] + s[:, None] * a)[meet]


def _contains(corners: Floats, place: Floats, tolerance: float) -> Marks:
    """(t,) whether simplices with corners (t, d, d) contain a place (d,), or have it on their rim."""
    edges, to = corners[:, 1:] - corners[:, :1], place - corners[:, 0]
    weights = np.einsum("ckj,cj->ck", np.linalg.pinv(edges.swapaxes(1, 2)), to)
    off = np.linalg.norm(to - np.einsum("ck,ckj->cj", weights, edges), axis=1)
    least = np.minimum(weights.min(axis=1), 1.0 - weights.sum(axis=1))
    return np.asarray((off <= tolerance) & (least >= -tolerance / np.linalg.norm(edges, axis=2).max(axis=1)))


def _stars(rows: Integers, points: Floats, place: Floats, tolerance: float) -> Iterator[_Star]:
    """The connected parts of simplices (a, d) at a place (d,) that surround the place completely."""
    used, numbers = np.unique(rows, return_inverse=True)
    parts = parts_of(numbers.reshape(rows.shape), len(used))
    for part in range(parts.max(initial=-1) + 1):
        rays, outward = [], []
        ends: list[int] = []
        for row in rows[parts == part]:
            normal = area_vectors(points, row[None] if len(row) == 2 else np.append(row, -1)[None])[0]
            to = points[row] - place
            for side in combinations(range(len(row)), len(row) - 1):
                spanned = to[list(side)]
                if np.linalg.norm(spanned, axis=1).min() <= tolerance:
                    continue
                unit = spanned / np.linalg.norm(spanned, axis=1)[:, None]
                if np.linalg.det(unit @ unit.T) > _ALONG**2:  # otherwise the place is on the side
                    rays.append(unit)
                    outward.append(normal / max(float(np.linalg.norm(normal)), np.finfo(float).tiny))
                    ends += row[list(side)].tolist() if len(side) > 1 else [-1]
        if rays and all(number % 2 == 0 for number in Counter(ends).values()):
            yield _Star(np.array(rays), np.array(outward))
