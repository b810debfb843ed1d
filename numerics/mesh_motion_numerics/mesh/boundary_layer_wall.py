"""The moving walls of a mesh and their deformation at each of their nodes.

A wall is a connected part of the boundary whose nodes have prescribed positions and at least one of which moves: a flag
and the fixed cylinder to which it is clamped are one wall, the channel around them is not a moving wall.

A facet f of the wall (an edge in 2D, a triangle in 3D; a quad is two triangles) with the edge vectors e and the unit
normal n deforms by ``F = [e' n'] [e n]⁻¹``, thesis (5.10). At a node, an edge o that leaves the wall shall go to F o at
each of its facets, and its height above the facet counts more than its place along it::

    G o = argmin_o'  Σ_f α_f [ (n'·(o' − F o))² + κ |(I − n' nᵀ') (o' − F o)|² ]

So an edge normal to a smooth wall stays normal and keeps its length, and a rigid wall carries its edges rigidly. At a
sharp edge of a wall that is stretched or sheared, where o is nearly in the plane of the facets, it follows them: the
rotation alone would tilt it by more than its height. The facets' weights α_f are their angles at the node, which do not
depend on how the wall is meshed. Neighbouring nodes share facets, so G varies smoothly where the wall bends smoothly.

Where the facets are much smaller than the height of the layer, a noise of single nodes would turn its outer nodes by
many times as much: half a chord behind a cusped trailing edge by 16 times, in an O-grid by 9 times. There both sums are
means over the nodes within half of this height, with the weights of compact support (1 − r²/ρ²)² (6 and 6 times).

References
----------
J. A. Bærentzen, H. Aanæs, "Signed distance computation using the angle weighted pseudonormal", IEEE Trans. Vis. Comput.
Graph. 11 (2005) 243–253.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from scipy.sparse import csr_array, eye_array
from scipy.spatial import cKDTree

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.closest_point import nearest_within
from mesh_motion_numerics.mesh.neighbours import parts_of
from mesh_motion_numerics.mesh.points import marks_at
from mesh_motion_numerics.mesh.roles import BoundaryRoles, Patch
from mesh_motion_numerics.mesh.smooth_pieces import as_simplices, of_one_width

ALONG = 0.5
"""κ: a wing in prisms that bends and twists keeps 0.88 of its shape with it, 0.83 with 0.1, 0.87 with 1."""
_ON_CORNER = 1e-9  # share of a facet's corner below which a place does not touch the corner
_SPREAD = 0.5  # ρ as a share of the layer's height
_MOST_NEAR = {2: 33, 3: 9}  # nodes in a mean, at most: those of a large wall in 3D need memory


class WallPlaces(NamedTuple):
    """Places on a wall."""

    corners: Integers  # (l, d). Rows of the wall's nodes: the corners of the facet on which each place lies
    weights: Floats  # (l, d). Barycentric coordinates

    def of(self, values: Floats) -> Floats:
        """Values (w, d) of the wall's nodes, interpolated at the places: (l, d)."""
        return np.asarray(np.einsum("lj,ljd->ld", self.weights, values[self.corners]))


@dataclass(frozen=True, eq=False)
class MovingWall:
    """The boundary facets of all moving walls."""

    nodes: Integers  # (w,). Mesh nodes, ascending
    reference: Floats  # (w, d), mesh length unit. Their positions in the reference mesh
    simplices: Integers  # (s, d). Rows of ``nodes``: segments in 2D, triangles in 3D
    #: (w,), mesh length unit, or None. Of the layer that moves with the wall, at each node.
    heights: Floats | None = None

    @classmethod
    def build(cls, points: Floats, facets: Mapping[str, Integers], moving: Marks, prescribed: Marks) -> Self:
        """The walls among the boundary facets of a mesh.

        Parameters
        ----------
        points : (n, d) array, mesh length unit
            Reference coordinates.
        facets : mapping of type to (f, k) int64 array
            The boundary.
        moving, prescribed : (n,) bool arrays
            Nodes that move; moving and fixed nodes.
        """
        simplices = as_simplices(of_one_width(facets))
        own = simplices[prescribed[simplices].all(axis=1)]
        body = parts_of(own, len(points))
        moves = np.isin(body, body[moving[own].all(axis=1)])
        nodes, rows = np.unique(own[moves], return_inverse=True)
        return cls(nodes, points[nodes], rows.reshape(-1, own.shape[1]))

    @classmethod
    def of_patches(cls, points: Floats, facets: Mapping[str, Integers], patches: Mapping[str, Patch]) -> Self | None:
        """Build the walls on the ``patches`` of a mesh (n, d) with boundary ``facets``; None without any, and in 1D."""
        if points.shape[1] < 2:
            return None
        roles = BoundaryRoles.from_patches(patches)
        moving, prescribed = (marks_at(len(points), nodes) for nodes in (roles.moving, roles.prescribed))
        wall = cls.build(points, facets, moving, prescribed)
        return wall if len(wall.simplices) else None

    @property
    def normals(self) -> Floats:
        """(s, d) unit normals in the reference mesh."""
        return facet_frames(self.reference[self.simplices])[:, :, -1]

    @cached_property
    def bodies(self) -> Integers:
        """(s,) number of the connected part of each facet."""
        return parts_of(self.simplices, len(self.nodes))

    def body_sides(self, box: Floats) -> Floats:
        """(s,) longest side of each segment's body in 2D, mesh length unit.

        0 if the body has an end, or is not in the interior of the box (2, 2).
        """
        body, d = self.bodies, self.reference.shape[1]
        closed = np.ones(body.max(initial=-1) + 1, dtype=bool)
        closed[body[(np.bincount(self.simplices.ravel())[self.simplices] != 2).any(axis=1)]] = False
        low, high = np.full((len(closed), d), np.inf), np.full((len(closed), d), -np.inf)
        corners = self.reference[self.simplices]
        np.minimum.at(low, body, corners.min(axis=1))
        np.maximum.at(high, body, corners.max(axis=1))
        inside = closed & ((low > box[0]) & (high < box[1])).all(axis=1)
        return np.asarray(np.where(inside, (high - low).max(axis=1, initial=0.0), 0.0)[body])

    def closest(self, points: Floats, within: float = np.inf) -> tuple[WallPlaces, Integers]:
        """The places of the reference wall nearest to points (l, d), and the facet (l,) on which each lies.

        If the wall is farther than ``within``, mesh length unit, the facet is −1 and the place is undefined.
        """
        corners = self.reference[self.simplices]
        places, facets = nearest_within(corners, points, within)
        places = np.where(facets[:, None] >= 0, places, corners[facets, 0])
        edges = corners[facets, 1:] - corners[facets, :1]  # (l, d - 1, d)
        gram = np.einsum("lid,ljd->lij", edges, edges)
        right = np.einsum("lid,ld->li", edges, places - corners[facets, 0])
        along = np.clip(np.linalg.solve(gram, right[:, :, None])[:, :, 0], 0.0, 1.0)
        weights = np.column_stack([np.clip(1.0 - along.sum(axis=1), 0.0, 1.0), along])
        weights[weights < _ON_CORNER] = 0.0
        weights /= weights.sum(axis=1, keepdims=True)
        return WallPlaces(self.simplices[facets], weights), facets

    def deformations(self, moved: Floats) -> Floats:
        """(w, d, d) G at each node when the nodes are at ``moved`` (w, d)."""
        return np.asarray(np.linalg.solve(*self.deformation_sums(moved)), dtype=np.float64)

    def deformation_sums(self, moved: Floats) -> tuple[Floats, Floats]:
        """A and B (w, d, d) of G = A⁻¹ B: the sums of W and W F over the facets, W = κ I + (1 − κ) n' nᵀ'."""
        own = facet_frames(moved[self.simplices])
        weighting = weighting_of(own)
        return _summed(self.around, weighting), _summed(self.around, weighting @ own @ self.at_rest[0])

    @cached_property
    def at_rest(self) -> tuple[Floats, Floats]:
        """Inverses of the facets' frames (s, d, d) and the angles (s, d) in the reference mesh."""
        corners = self.reference[self.simplices]
        return np.asarray(np.linalg.inv(facet_frames(corners)), dtype=np.float64), _angles_at_corners(corners)

    @property
    def mean_projections(self) -> Floats:
        """(w, d, d) mean of n nᵀ over each node's facets in the reference mesh."""
        own, normals = self._own, self.normals
        return np.asarray(_summed(own, normals[:, :, None] * normals[:, None, :]) / own.sum(axis=1)[:, None, None])

    @cached_property
    def _own(self) -> csr_array:
        """(w, s) the facets' angles at their nodes."""
        facets = np.repeat(np.arange(len(self.simplices)), self.simplices.shape[1])
        shape = len(self.nodes), len(self.simplices)
        return csr_array((self.at_rest[1].ravel(), (self.simplices.ravel(), facets)), shape=shape)

    @cached_property
    def around(self) -> csr_array:
        """(w, s) the facets' weights α_f in the sums at each node."""
        if self.heights is None:
            return self._own
        d, count = self.reference.shape[1], len(self.nodes)
        distance, near = cKDTree(self.reference).query(self.reference, min(_MOST_NEAR[d], count))
        distance, near = distance.reshape(count, -1), near.reshape(count, -1)
        radius = np.minimum(_SPREAD * self.heights, distance[:, -1])
        body = np.empty(count, dtype=np.int64)
        body[self.simplices.ravel()] = np.repeat(self.bodies, d)
        row, column = np.nonzero((distance < radius[:, None]) & (body[near] == body[:, None]) & (distance > 0.0))
        other = near[row, column]
        sizes = np.abs(np.linalg.det(facet_frames(self.reference[self.simplices])))  # of triangles twice the area
        extent = np.bincount(self.simplices.ravel(), np.repeat(sizes, d), count) / self._own.sum(axis=1)
        weights = (1.0 - (distance[row, column] / radius[row]) ** 2) ** 2 * extent[other] / extent[row]
        means = csr_array((weights, (row, other)), shape=(count, count)) + eye_array(count, format="csr")
        return csr_array(means @ self._own)


def _summed(weights: csr_array, values: Floats) -> Floats:
    """(w, d, d) sums of the facets' values (s, d, d) with weights (w, s)."""
    return np.asarray(weights @ values.reshape(len(values), -1)).reshape(-1, *values.shape[1:])


def _angles_at_corners(corners: Floats) -> Floats:
    """(s, d) angle of each facet at each of its corners (s, d, d); equal for all segments."""
    if corners.shape[1] == 2:
        return np.ones(corners.shape[:2])
    out = np.empty(corners.shape[:2])
    for i in range(3):
        a, b = (corners[:, (i + k) % 3] - corners[:, i] for k in (1, 2))
        out[:, i] = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.sum(a * b, axis=1))
    return out


def weighting_of(frames: Floats) -> Floats:
    """(s, d, d) W = κ I + (1 − κ) n' nᵀ' of facets with ``frames`` (s, d, d)."""
    normal = frames[:, :, -1]
    return ALONG * np.eye(normal.shape[1]) + (1.0 - ALONG) * normal[:, :, None] * normal[:, None, :]


def facet_frames(corners: Floats) -> Floats:
    """(s, d, d) matrices with the edges from the first corner and the unit normal as columns, of corners (s, d, d)."""
    edges = corners[:, 1:] - corners[:, :1]
    if edges.shape[1] == 1:
        normal = np.column_stack([edges[:, 0, 1], -edges[:, 0, 0]])
    else:
        normal = np.cross(edges[:, 0], edges[:, 1])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    unit = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0.0)
    return np.concatenate([np.swapaxes(edges, 1, 2), unit[:, :, None]], axis=2)
