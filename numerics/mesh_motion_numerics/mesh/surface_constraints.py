"""Constraints of sliding nodes: on planes through their reference place, on facets of the reference mesh, or held.

Facets that all contain one direction, such as a cylinder's wall, go on along it: a piston that is pulled out of its
place at rest takes the nodes on the wall along. Those of revolution about the axis of a periodic sector go on around
it: nodes on a hub pass the place at rest of a blade's root.

Each constraint returns an admissible position (projection), exactly on the planes or facets; on planes it is the
nearest one. It also returns the tangential directions there, for steps that are projected afterwards. For both, on
facets the normal (on a curve the tangent) is interpolated between the corners, so that it turns smoothly at the kinks
between facets. The nearest point would jump over a kink from one facet to the next, and a flow solver would see a mesh
velocity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.closest_point import FacetSet
from mesh_motion_numerics.mesh.coincidence import first_at_place
from mesh_motion_numerics.mesh.projection_slope import facet_angles, smooth_slopes
from mesh_motion_numerics.mesh.revolution import about, turned_to, turns_onto_itself
from mesh_motion_numerics.mesh.rigid_transforms import Transform, nearest_images

#: Planes whose normals differ by less (as a sine) count as one plane: their line of intersection is not determined.
_PARALLEL = 1e-6
#: Components of a direction below this are 0: along a coordinate axis the other coordinates stay bitwise.
_AXIS = 1e-9
#: A place this close to a facet, as a share of its first edge, is on it.
_ON_FACET = 1e-8
#: Nodes nearer to each other than this share of the shortest facet are images of each other.
_SAME_NODE = 0.01


class SurfaceConstraint(Protocol):
    """The constraint of some nodes."""

    @property
    def freedom(self) -> int:
        """Dimension of the space of directions in which a node may move: 0 if it stays."""
        ...

    def project(self, positions: Floats, reference: Floats) -> Floats:
        """Admissible positions (m, d) near the given ones, of nodes with ``reference`` positions (m, d)."""
        ...

    def tangents(self, positions: Floats, reference: Floats) -> Floats:
        """(m, d, d) orthogonal projectors onto the directions in which nodes at admissible positions (m, d) can go."""
        ...

    def slope(self, positions: Floats, reference: Floats) -> Floats:
        """(m, d, d) derivative of :meth:`project` by the positions (m, d), which may be anywhere."""
        ...


@dataclass(frozen=True, eq=False)
class OnPlanes:
    """Orthonormal normals (r, d) of the planes through each node's reference place."""

    normals: Floats

    @classmethod
    def from_normals(cls, normals: Sequence[Floats]) -> OnPlanes:
        """Build it from unit normals (d,), in their order; nearly parallel normals count once."""
        basis: list[Floats] = []
        for normal in normals:
            rest = normal.copy()
            for known in basis:
                rest -= (rest @ known) * known
            length = float(np.linalg.norm(rest))
            if length > _PARALLEL:
                basis.append(rest / length)
        return cls(np.array(basis))

    def along(self, direction: Floats) -> Floats:
        """The part of a ``direction`` (d,) that lies in all the planes."""
        return np.asarray(direction - self.normals.T @ (self.normals @ direction))

    @property
    def freedom(self) -> int:
        return int(self.normals.shape[1] - len(self.normals))

    def project(self, positions: Floats, reference: Floats) -> Floats:
        out = positions.copy()
        for normal in self.normals:
            axis = int(np.argmax(np.abs(normal)))
            if np.count_nonzero(normal) == 1:  # along a coordinate: the other coordinates stay bitwise
                out[:, axis] = reference[:, axis]
            else:
                out -= np.sum((out - reference) * normal, axis=1)[:, None] * normal
        return out

    def tangents(self, positions: Floats, reference: Floats) -> Floats:
        del reference
        d = self.normals.shape[1]
        projector = np.eye(d) - self.normals.T @ self.normals
        return np.broadcast_to(projector, (len(positions), d, d))

    def slope(self, positions: Floats, reference: Floats) -> Floats:
        return self.tangents(positions, reference)


@dataclass(frozen=True, eq=False)
class OnFacets:
    """Segments (a curve) or triangles (a surface) of the reference mesh."""

    facets: FacetSet
    corners: Floats  # (f, 2 or 3, d), mesh length unit
    #: (f, 2 or 3, d, d). At each corner the sum of t tᵀ over the segments, or of n nᵀ over the triangles, that meet
    #: there, weighted by their size: its first eigenvector is the tangent of the curve, or the normal of the surface.
    tensors: Floats
    #: Generators of a periodic domain. The object has the facets and their next images; a node that has passed more
    #: periods is first taken back by these.
    images: Sequence[Transform] = ()
    #: (f, 2 or 3). The ends of the curve, or of the surface: whether no other facet continues opposite each corner.
    ends: Marks | None = None
    #: An image's rotation about the axis of this surface of revolution: it goes on where it ends at a hole, as at the
    #: root of a blade.
    turn: Transform | None = None

    @classmethod
    def from_simplices(cls, points: Floats, simplices: Integers, *, images: Sequence[Transform] = ()) -> OnFacets:
        """Build it from points (n, d), the nodes (f, 2 or 3) of segments or triangles, and their periodic images."""
        own = len(simplices)
        for image in images:
            count, forth = len(points), image(points)
            points = np.concatenate([points, forth, image.inverse()(points)])
            simplices = np.concatenate([simplices, simplices + count, simplices + 2 * count])
        corners = points[simplices]
        direction = _direction(corners)
        size = np.linalg.norm(direction, axis=1)[:, None, None]
        outer = direction[:, :, None] * direction[:, None, :] / size
        used, numbers = np.unique(simplices, return_inverse=True)
        # a periodic side also has the nodes of the next image: directions there come from the facets on both sides
        shortest = float(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1).min())
        numbers = first_at_place(points[used], shortest, _SAME_NODE)[numbers].reshape(simplices.shape)
        tensors = np.zeros((len(used), *outer.shape[1:]))
        for column in numbers.T:
            np.add.at(tensors, column, outer)
        ends, turn = _ends(numbers), None
        if ends[:own].any():
            turn = next((image for image in images if image.turns and turns_onto_itself(corners, image)), None)
        return cls(FacetSet(corners), corners, tensors[numbers], images, ends, turn)

    @property
    def freedom(self) -> int:
        return int(self.corners.shape[1] - 1)

    def project(self, positions: Floats, reference: Floats) -> Floats:
        near, rotations, shifts, _ = self._near(positions, reference)
        places = self.facets.smooth(near, self._directions)
        return np.asarray(np.einsum("mij,mj->mi", rotations, places) + shifts)

    def _near(self, positions: Floats, reference: Floats) -> tuple[Floats, Floats, Floats, Integers]:
        """As :func:`.nearest_images`; rows (k,) that the facets end at are turned to the angle of their reference."""
        near, rotations, shifts = nearest_images(positions, reference, self.images)
        if self.turn is None or self.ends is None:
            return near, rotations, shifts, np.empty(0, dtype=np.int64)
        places = self.facets.smooth(near, self._directions)
        rows, facets = self.facets.containing(places)
        weights = _barycentric(places[rows], self.corners[facets])
        away = np.linalg.norm(np.einsum("qk,qkd->qd", weights, self.corners[facets]) - places[rows], axis=1)
        at_end = ((weights <= _ON_FACET) & self.ends[facets]).any(axis=1)
        at_end &= away <= _ON_FACET * np.linalg.norm(self.corners[facets, 1] - self.corners[facets, 0], axis=1)
        ended = np.unique(rows[at_end])
        if len(ended):
            near[ended], rotations[ended], shifts[ended] = turned_to(positions[ended], reference[ended], self.turn)
        return near, rotations, shifts, ended

    @cached_property
    def _directions(self) -> Floats:
        """(f, 2 or 3, d) the curve's tangent, or the surface's normal, at each corner, oriented like the facet."""
        first = np.linalg.eigh(self.tensors)[1][..., -1]
        return first * np.where(np.einsum("fki,fi->fk", first, _direction(self.corners)) < 0.0, -1.0, 1.0)[..., None]

    @property
    def straight(self) -> OnPlanes | None:
        """Planes along the direction that lies in every facet, as on the wall of a cylinder; None without one."""
        unit = _direction(self.corners)
        size = np.linalg.norm(unit, axis=1)
        unit = unit[size > 0.0] / size[size > 0.0, None]
        across = unit[:, :, None] * unit[:, None, :]
        if self.freedom == 1:
            across = np.eye(unit.shape[1]) - across
        along = np.linalg.eigh(across.sum(axis=0))[1][:, 0]
        if np.linalg.norm(across @ along, axis=1).max() > _PARALLEL:
            return None
        along = OnPlanes.from_normals([np.where(np.abs(along) < _AXIS, 0.0, along)]).normals[0]
        axes = np.delete(np.eye(len(along)), np.argmax(np.abs(along)), axis=0)
        return OnPlanes(OnPlanes.from_normals([along, *axes]).normals[1:])

    def tangents(self, positions: Floats, reference: Floats) -> Floats:
        near, rotations, *_ = self._near(positions, reference)
        places, rows = self.facets.nearest(near)
        weights = _barycentric(places, self.corners[rows])
        tensor = rotations @ np.einsum("mk,mkij->mij", weights, self.tensors[rows]) @ np.swapaxes(rotations, 1, 2)
        first = np.linalg.eigh(tensor)[1][:, :, -1]
        outer = first[:, :, None] * first[:, None, :]
        return outer if self.freedom == 1 else np.asarray(np.eye(outer.shape[1]) - outer)

    def slope(self, positions: Floats, reference: Floats) -> Floats:
        """As :meth:`.SurfaceConstraint.slope`; at a corner or an edge of facets the mean over these, by their angles.

        The motion has a kink there; the result is the mean of the derivatives on all sides.
        """
        near, rotations, _, ended = self._near(positions, reference)
        places = self.facets.smooth(near, self._directions)
        rows, facets = self.facets.containing(places)
        corners = self.corners[facets]
        weights = _barycentric(places[rows], corners)
        away = np.linalg.norm(np.einsum("qk,qkd->qd", weights, corners) - places[rows], axis=1)
        on = away <= _ON_FACET * np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
        rows, corners, weights = rows[on], corners[on], weights[on]
        smooth, slopes = smooth_slopes(near[rows] - places[rows], corners, self._directions[facets[on]], weights)
        led = np.zeros(len(near), dtype=bool)
        led[rows[smooth]] = True  # found by a normal; the other points are the nearest ones
        share = np.where(smooth | ~led[rows], facet_angles(corners, weights), 0.0)
        found = np.zeros((*near.shape, near.shape[1]))
        np.add.at(found, rows, (share / np.bincount(rows, share, len(near))[rows])[:, None, None] * slopes)
        if self.turn is not None and len(ended):  # the angle about the axis follows the position, too
            before, after = (about(self.turn, at[ended]) for at in (near, places))
            rates = before / np.sum(before * before, axis=1, keepdims=True)
            found[ended] += (after - np.einsum("kij,kj->ki", found[ended], before))[:, :, None] * rates[:, None, :]
        return rotations @ found @ np.swapaxes(rotations, 1, 2)


@dataclass(frozen=True, eq=False)
class OnPrism:
    """The wall of a cylinder or prism: it has no end along its straight direction, like a plane."""

    straight: OnPlanes  # planes along the straight direction
    section: OnFacets  # the curve of the wall in the coordinates (k, 2) along the planes' normals
    freedom: int = 2

    def project(self, positions: Floats, reference: Floats) -> Floats:
        across = self._across(positions)
        moved = self.section.project(across, self._across(reference)) - across
        return np.asarray(positions + moved @ self.straight.normals)

    def tangents(self, positions: Floats, reference: Floats) -> Floats:
        return self._in_space(self.section.tangents(self._across(positions), self._across(reference)))

    def slope(self, positions: Floats, reference: Floats) -> Floats:
        return self._in_space(self.section.slope(self._across(positions), self._across(reference)))

    def _across(self, positions: Floats) -> Floats:
        return np.asarray(positions @ self.straight.normals.T)

    def _in_space(self, matrices: Floats) -> Floats:
        """(m, 3, 3) matrices of the section's (m, 2, 2): the straight direction stays."""
        normals = self.straight.normals
        return np.asarray(normals.T @ matrices @ normals + np.eye(3) - normals.T @ normals)


def endless(surface: OnFacets) -> SurfaceConstraint:
    """The same surface or curve, without an end along a direction that lies in all its facets, if there is one."""
    planes = None if surface.images else surface.straight
    if planes is None or surface.freedom == 1:
        return planes or surface
    corners = surface.corners @ planes.normals.T
    places = corners.reshape(-1, 2)
    numbers = first_at_place(places, float(np.ptp(places, axis=0).max()), _PARALLEL).reshape(-1, 3)
    edges = np.concatenate([numbers[:, [0, 1]], numbers[:, [1, 2]], numbers[:, [2, 0]]])
    edges = np.unique(np.sort(edges[edges[:, 0] != edges[:, 1]], axis=1), axis=0)
    if np.bincount(edges.ravel()).max() > 2:
        return surface  # the facets' sides do not lie along the straight direction: no simple curve
    return OnPrism(planes, OnFacets.from_simplices(places, edges))


@dataclass(frozen=True, eq=False)
class Held:
    """The node is held at its reference place."""

    freedom: int = 0

    def project(self, positions: Floats, reference: Floats) -> Floats:
        del positions
        return reference.copy()

    def tangents(self, positions: Floats, reference: Floats) -> Floats:
        del reference
        return np.zeros((*positions.shape, positions.shape[1]))

    def slope(self, positions: Floats, reference: Floats) -> Floats:
        return self.tangents(positions, reference)


def _ends(numbers: Integers) -> Marks:
    """(f, k) whether the rest of a facet (f, k), without each corner, belongs to no other facet."""
    k = numbers.shape[1]
    rests = np.stack([np.delete(numbers, corner, axis=1) for corner in range(k)], axis=1).reshape(-1, k - 1)
    _, place, counts = np.unique(np.sort(rests, axis=1), axis=0, return_inverse=True, return_counts=True)
    return np.asarray(counts[place.ravel()].reshape(-1, k) == 1)


def _direction(corners: Floats) -> Floats:
    """(f, d) edges of segments (f, 2, d), or normals of triangles (f, 3, d), as long as their size."""
    edges = corners[:, 1:] - corners[:, :1]
    return edges[:, 0] if corners.shape[1] == 2 else np.cross(edges[:, 0], edges[:, 1])


def _barycentric(places: Floats, corners: Floats) -> Floats:
    """(m, 2 or 3) weights of the corners (m, 2 or 3, d) that give places (m, d) on their facets."""
    edges, away = corners[:, 1:] - corners[:, :1], places - corners[:, 0]
    gram = np.einsum("mid,mjd->mij", edges, edges)
    right = np.einsum("mid,md->mi", edges, away)
    rest = np.einsum("mij,mj->mi", np.linalg.pinv(gram, hermitian=True), right)
    return np.asarray(np.clip(np.column_stack([1.0 - rest.sum(axis=1), rest]), 0.0, 1.0))
