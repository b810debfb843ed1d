"""Slip and symmetry patches: nodes that may move along their surface, and must not leave it.

A sliding node's reference position lies on smooth pieces of the sliding patches. They determine where it may move:

- planar pieces: its own plane through its reference place; on two, their line of intersection; on three, it stays;
- one curved piece: the piece's facets in the reference mesh, which represent the surface exactly as the mesh does (if
  all contain one direction, as a cylinder's do, the surface has no end in that direction);
- a curved and another piece: the curve where they meet; on more pieces, it stays.

Pieces in one plane count once: a far field that is cut into two patches slides like one patch, as with OpenFOAM's slip
condition. Otherwise the node between the patches would be held, although the boundary has no edge there. So a corner
stays a corner, an edge an edge, and a box whose six sides are one patch keeps its shape. All surfaces are those of the
reference mesh: repeated projections cause no drift.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.endless_walls import axis_of, endless_nodes
from mesh_motion_numerics.mesh.paths import RigidMotion
from mesh_motion_numerics.mesh.points import marks_at, rows_among
from mesh_motion_numerics.mesh.rigid_transforms import Transform
from mesh_motion_numerics.mesh.smooth_pieces import Piece, sides, smooth_pieces
from mesh_motion_numerics.mesh.surface_constraints import Held, OnFacets, OnPlanes, OnPrism, SurfaceConstraint, endless
from mesh_motion_numerics.mesh.wall_lines import EvenedLine, WallLine, wall_lines

#: A wall maps onto itself if its nodes leave it by less than this share of their motion: true for a circle of 16
#: segments in a rotation.
ACROSS = 0.2
#: … or by at most rounding, relative to the coordinates.
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class SlidingSurfaces:
    """The constraints of all sliding nodes."""

    nodes: Integers  # (s,). The sliding nodes, in the order of the rows of :meth:`project`
    reference: Floats  # (s, d), mesh length unit. Their reference positions
    #: tuple of (rows, constraint). Each row of ``nodes`` is in exactly one group.
    groups: tuple[tuple[Integers, SurfaceConstraint], ...]
    pieces: tuple[Piece, ...] = ()  # the smooth pieces of the patches
    lines: tuple[WallLine, ...] = ()  # lines along which some of the nodes slide
    #: (n,) bool array or None. Nodes on curved walls without an end, which only follow the mesh's rigid motion; None
    #: without any.
    endless: Marks | None = None
    axis: Transform | None = None  # a rotation about the only axis about which that motion turns
    turns: bool = True  # whether that motion may turn at all

    @classmethod
    def build(
        cls,
        points: Floats,
        facets: Mapping[str, Integers],
        patches: Mapping[str, Integers],
        nodes: Integers,
        *,
        images: Sequence[Transform] = (),
        mirrors: Collection[str] = (),
    ) -> SlidingSurfaces:
        """Find the surfaces of the sliding nodes.

        Raises InvalidInput if a sliding node lies on no boundary facet of its patches, or a symmetry patch is curved.

        Parameters
        ----------
        points : (n, d) array, mesh length unit
            Reference coordinates.
        facets : dict of (f, k) int64 arrays
            The facets of the whole boundary, with outward normals, by type.
        patches : dict of (p,) int64 arrays
            Node indices of each slip or symmetry patch, including nodes with another role of higher precedence.
        nodes : (s,) int64 array
            The nodes that slide.
        images : sequence of Transform
            Images of a periodic domain: a curved surface continues behind its periodic sides.
        mirrors : collection of str
            Symmetry patches: each of their smooth pieces must be planar.
        """
        for name in sorted(mirrors):
            _refuse_curved(points, name, smooth_pieces(points, facets, patches[name]))
        pieces = _pieces(points, facets, patches)
        keys = _pieces_of(pieces, len(points), nodes)
        _refuse_stray(keys, patches, nodes)
        rows: dict[tuple[int, ...], list[int]] = {}
        for row, key in enumerate(keys):
            rows.setdefault(key, []).append(row)
        groups = tuple(
            (np.array(members, dtype=np.int64), _constraint(points, [pieces[i] for i in key], images))
            for key, members in rows.items()
        )
        found = cls(nodes, points[nodes], groups, tuple(pieces))
        freedom = np.zeros(len(points), dtype=np.int64)
        freedom[nodes] = found.freedom()
        return replace(found, lines=wall_lines(points, pieces, freedom))

    def with_endless(self, points: Floats, *, periodic: bool) -> SlidingSurfaces:
        """The same surfaces, with those of the mesh (n, d) that have no end; if it is periodic, it gives the axis."""
        sliding = marks_at(len(points), self.nodes)
        endless = endless_nodes(self.pieces, sliding)
        if not endless.any():
            return self
        axis, ball = (None, True) if periodic else axis_of(points, self.pieces)
        return replace(self, endless=endless, axis=axis, turns=axis is not None or ball)

    def project(self, positions: Floats) -> Floats:
        """The admissible positions nearest to ``positions`` (s, d), a row for each of ``nodes``; mesh length unit."""
        out = np.empty_like(self.reference)
        for rows, constraint in self.groups:
            out[rows] = constraint.project(positions[rows], self.reference[rows])
        return out

    def in_order(self, positions: Floats, known: Marks) -> Floats:
        """The nodes' positions (n, d), with those of every line in order between the ``known`` (n,) nodes."""
        out = positions.copy()
        for line in self.lines:
            out[line.nodes] = line.in_order(positions[line.nodes], known[line.nodes])
        return out

    def evened(self, before: Floats, positions: Floats, known: Marks) -> Floats:
        """The nodes' positions (n, d) after a motion from ``before`` (n, d); spacings on curved lines change less."""
        out = positions.copy()
        for line in self.evened_lines(before, positions, known):
            out[line.nodes] = line.places
        return out

    def evened_lines(self, before: Floats, positions: Floats, known: Marks) -> list[EvenedLine]:
        """The curved lines of :meth:`evened`, with their derivatives."""
        return [
            EvenedLine.build(line, before[line.nodes], positions[line.nodes], known[line.nodes])
            for line in self.lines
            if not line.is_straight
        ]

    def admitted(self, rigid: RigidMotion, positions: Floats) -> RigidMotion | None:
        """The rigid motion without its shift across plane walls; None if the walls do not map onto themselves.

        Parameters
        ----------
        positions : (s, d) array, mesh length unit
            Admissible positions of the nodes at the start of the motion.
        """
        shift = rigid.translation if self.planes is None else self.planes.along(rigid.translation)
        along = replace(rigid, translation=shift)
        carried = along.apply(positions)
        moved, off = (np.linalg.norm(carried - at, axis=1) for at in (positions, self.project(carried)))
        rounding = _ROUNDING * float(np.abs(self.reference).max())
        return along if (off <= ACROSS * moved + rounding).all() else None

    @property
    def planes(self) -> OnPlanes | None:
        """The planes of all plane walls; None without any."""
        normals = [piece.normal for piece in self.pieces if piece.normal is not None]
        return OnPlanes.from_normals(normals) if normals else None

    def tangents(self, positions: Floats) -> Floats:
        """(s, d, d) projectors onto the directions in which nodes at admissible positions (s, d) may move."""
        out = np.empty((*positions.shape, positions.shape[1]))
        for rows, constraint in self.groups:
            out[rows] = constraint.tangents(positions[rows], self.reference[rows])
        return out

    def slope(self, positions: Floats) -> Floats:
        """(s, d, d) derivative of :meth:`project` by the ``positions`` (s, d)."""
        out = np.empty((*positions.shape, positions.shape[1]))
        for rows, constraint in self.groups:
            out[rows] = constraint.slope(positions[rows], self.reference[rows])
        return out

    def freedom(self) -> Integers:
        """(s,) dimension of the space of those directions; 0 for a node that cannot move."""
        out = np.zeros(len(self.nodes), dtype=np.int64)
        for rows, constraint in self.groups:
            out[rows] = constraint.freedom
        return out

    @property
    def curved(self) -> bool:
        """Whether nodes slide on facets, so that the derivative of :meth:`project` depends on their positions."""
        return any(isinstance(constraint, OnFacets | OnPrism) for _, constraint in self.groups)

    @cached_property
    def by_freedom(self) -> tuple[SlidingSurfaces, ...]:
        """The nodes of each freedom, the smallest first: corners, then lines, then surfaces."""
        freedom = self.freedom()
        if self.endless is not None:
            freedom[self.endless[self.nodes]] = -1  # before all others
        return tuple(self.of(freedom == value) for value in np.unique(freedom))

    @property
    def only_carried(self) -> bool:
        """Whether these nodes follow nothing but the mesh's rigid motion."""
        return self.endless is not None and bool(self.endless[self.nodes].all())

    def held(self) -> SlidingSurfaces:
        """The same nodes, all of them held at their reference places."""
        return replace(self, groups=((np.arange(len(self.nodes)), Held()),))

    @property
    def is_held(self) -> bool:
        """Whether these are the nodes of :meth:`held`."""
        return all(isinstance(constraint, Held) for _, constraint in self.groups)

    def of(self, chosen: Marks) -> SlidingSurfaces:
        """The constraints of some of the nodes: where ``chosen`` (s,) is true."""
        number = np.cumsum(chosen) - 1
        groups = tuple((number[rows[chosen[rows]]], c) for rows, c in self.groups if chosen[rows].any())
        return replace(self, nodes=self.nodes[chosen], reference=self.reference[chosen], groups=groups)


def _pieces(points: Floats, facets: Mapping[str, Integers], patches: Mapping[str, Integers]) -> list[Piece]:
    """The smooth pieces of the patches; facets on two patches count once, and pieces in one plane are one piece."""
    found: dict[bytes, Piece] = {}
    for name in sorted(patches):
        for piece in smooth_pieces(points, facets, patches[name]):
            found.setdefault(piece.nodes.tobytes(), piece)
    whole: list[Piece] = []
    for piece in found.values():
        same = next((number for number, other in enumerate(whole) if other.in_plane_of(piece, points)), None)
        if same is None:
            whole.append(piece)
        else:
            whole[same] = whole[same].with_facets_of(piece)
    return whole


def _pieces_of(pieces: list[Piece], n_points: int, nodes: Integers) -> list[tuple[int, ...]]:
    """Numbers of the pieces that contain each node."""
    place = rows_among(n_points, nodes)
    keys: list[tuple[int, ...]] = [()] * len(nodes)
    for number, piece in enumerate(pieces):
        for row in place[piece.nodes]:
            if row >= 0:
                keys[row] = (*keys[row], number)
    return keys


def _refuse_stray(keys: list[tuple[int, ...]], patches: Mapping[str, Integers], nodes: Integers) -> None:
    """Raise if a sliding node has no surface."""
    stray = next((int(node) for node, key in zip(nodes, keys, strict=True) if not key), None)
    if stray is not None:
        owner = next((name for name, members in sorted(patches.items()) if stray in members), "")
        raise InvalidInput(
            f"node {stray} of the sliding patch {owner!r} lies on no boundary facet of that patch",
            code="INVALID_ARGUMENT.MESH",
            hint="list all nodes of the patch's facets, those on its rim included",
            details={"patch": owner, "node": stray},
        )


def _refuse_curved(points: Floats, name: str, pieces: list[Piece]) -> None:
    """Raise if a piece of a symmetry patch is not planar; names its node farthest from the best plane."""
    curved = next((piece for piece in pieces if piece.normal is None), None)
    if curved is None:
        return
    places = points[curved.nodes] - points[curved.nodes].mean(axis=0)
    away = np.abs(places @ np.linalg.svd(places, full_matrices=False)[2][-1])
    node = int(curved.nodes[np.argmax(away)])
    raise InvalidInput(
        f"the symmetry patch {name!r} is not planar: node {node} is {away.max():.3g} off its plane",
        code="INVALID_ARGUMENT.MESH",
        hint="give a curved surface the role slip",
        details={"patch": name, "node": node, "distance": float(away.max())},
    )


def _constraint(points: Floats, pieces: list[Piece], images: Sequence[Transform]) -> SurfaceConstraint:
    """The constraint of a node on these pieces."""
    normals = [piece.normal for piece in pieces if piece.normal is not None]
    if len(normals) == len(pieces):
        return OnPlanes.from_normals(normals)
    if len(pieces) == 1:
        return endless(OnFacets.from_simplices(points, pieces[0].simplices, images=images))
    curve = _common_sides(pieces) if len(pieces) == 2 else np.empty((0, 2), dtype=np.int64)
    along = len(curve) and curve.shape[1] == 2
    return endless(OnFacets.from_simplices(points, curve, images=images)) if along else Held()


def _common_sides(pieces: list[Piece]) -> Integers:
    """Sides (e, 1 or 2) that two pieces share: the curve where they meet."""
    first, second = (np.unique(sides(piece.facets)[0], axis=0) for piece in pieces)
    both = np.concatenate([first, second])
    found, counts = np.unique(both, axis=0, return_counts=True)
    return np.asarray(found[counts == 2], dtype=np.int64)
