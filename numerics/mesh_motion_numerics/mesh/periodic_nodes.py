"""Nodes that move together because the domain is periodic: pairs, and orbits where several patches meet.

The first node of each orbit, its root, moves; the others take its displacement, turned by the rotation between the two.
So pairs stay pairs: a node's image in the reference mesh remains its image, bitwise in each coordinate that the two
have in common. If a rotation of the orbit maps a node onto itself (it lies on the axis of a sector), the node can only
have displacements that this rotation leaves unchanged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.open_sector import OpenSector
from mesh_motion_numerics.mesh.paths import RigidMotion, fit_screw
from mesh_motion_numerics.mesh.periodic_pairs import PeriodicPair, is_same_period, periodic_pairs
from mesh_motion_numerics.mesh.points import marks_at
from mesh_motion_numerics.mesh.rigid_transforms import Transform
from mesh_motion_numerics.mesh.roles import BoundaryRoles, Patch

#: Two rotations are equal if their entries differ by less than this.
_UNCHANGED = 1e-9
#: Largest difference between the displacements of two moving images, relative to the domain's extent.
_TORN = 1e-6


@dataclass(frozen=True, eq=False)
class PeriodicNodes:
    """The orbits of a mesh's periodic nodes."""

    reference: Floats  # (n, d), mesh length unit. Coordinates of all nodes of the mesh
    #: members, roots: (p,). Each node on a periodic patch, ascending, and the root of its orbit.
    members: Integers
    roots: Integers
    rotations: Floats  # (p, d, d). Turn the root's displacement into the member's
    #: (p, d, d). Projections onto the displacements that the root's orbit allows; the identity except for nodes on an
    #: axis.
    projectors: Floats
    pairs: tuple[PeriodicPair, ...]

    @classmethod
    def of_pairs(cls, points: Floats, pairs: Sequence[PeriodicPair]) -> PeriodicNodes:
        """Build the orbits from the pairs of a mesh with reference coordinates ``points`` (n, d)."""
        links: dict[int, list[tuple[int, Transform]]] = {}
        for pair in pairs:
            back = pair.transform.inverse()
            for a, b in pair.nodes.tolist():
                links.setdefault(a, []).append((b, pair.transform))
                links.setdefault(b, []).append((a, back))
        members = np.array(sorted(links), dtype=np.int64)
        roots = np.full(len(members), -1, dtype=np.int64)
        d = points.shape[1]
        rotations, projectors = np.broadcast_to(np.eye(d), (2, len(members), d, d)).copy()
        row_of = {int(node): row for row, node in enumerate(members)}
        for row, root in enumerate(members.tolist()):
            if roots[row] < 0:
                found, projector = _orbit(root, links, d)
                rows = [row_of[node] for node in found]
                roots[rows] = root
                rotations[rows] = list(found.values())
                projectors[rows] = projector
        return cls(points, members, roots, rotations, projectors, tuple(pairs))

    @classmethod
    def build(
        cls, points: Floats, facets: Mapping[str, Integers], patches: Mapping[str, Patch], roles: BoundaryRoles
    ) -> PeriodicNodes | None:
        """Build the orbits of a mesh with reference coordinates ``points`` (n, d); None without periodic patches.

        ``facets`` (f, k): all facets of the boundary, by type.

        Raises InvalidInput if patches do not map onto each other, or a node and its image have different roles.
        """
        sides = {name: patch.nodes for name, patch in patches.items() if patch.role == "periodic"}
        if not sides:
            return None
        found = cls.of_pairs(points, periodic_pairs(points, facets, sides))
        found.check_kinds({kind: getattr(roles, kind) for kind in ("moving", "fixed", "sliding")})
        return found

    @cached_property
    def generators(self) -> tuple[Transform, ...]:
        """Generators of the group of all periodic images, each once."""
        found: list[Transform] = []
        for pair in self.pairs:
            if not any(is_same_period(pair.transform, known, self.reference) for known in found):
                found.append(pair.transform)
        return tuple(found)

    @cached_property
    def open_sector(self) -> OpenSector | None:
        """The sector whose angle is not a whole fraction of a turn; None if there is none."""
        return OpenSector.of(self.reference, self.generators)

    @property
    def turns(self) -> bool:
        """Whether a generator rotates."""
        return any(generator.turns for generator in self.generators)

    def root_of(self, nodes: Integers) -> Integers:
        """(k,) root of each of the nodes (k,); the node itself if it is in no orbit."""
        number = np.arange(len(self.reference))
        number[self.members] = self.roots
        return np.asarray(number[nodes])

    def tied(self, positions: Floats, left: Integers) -> Floats:
        """Positions (n, d) with every orbit placed by its root; the nodes ``left`` (k,) stay unchanged."""
        out = positions.copy()
        others = self.of(~np.isin(self.members, left))
        out[others.members] = others.images(positions[others.roots])
        return out

    @property
    def matrices(self) -> Floats:
        """(p, d, d) matrices that give a member's displacement from its root's."""
        return np.asarray(self.rotations @ self.projectors)

    @property
    def on_axis(self) -> Marks:
        """(p,) members that a rotation of their orbit maps onto themselves."""
        return np.asarray((self.projectors != np.eye(self.reference.shape[1])).any(axis=(1, 2)))

    def of(self, chosen: Marks) -> PeriodicNodes:
        """The ``chosen`` (p,) members only."""
        rotations, projectors = self.rotations[chosen], self.projectors[chosen]
        roots = self.roots[chosen]
        return PeriodicNodes(self.reference, self.members[chosen], roots, rotations, projectors, self.pairs)

    def renumbered(self, place: Integers, reference: Floats) -> PeriodicNodes:
        """The orbits that are complete in a part of the mesh with its nodes at ``reference`` (k, d).

        ``place`` (n,): each node's index in the part, ascending; -1 for nodes outside.
        """
        absent = marks_at(len(place), self.roots[place[self.members] < 0])
        kept = self.of(~absent[self.roots])
        return replace(kept, reference=reference, members=place[kept.members], roots=place[kept.roots])

    def closed(self, marked: Marks) -> Marks:
        """The marked (n,) nodes and all their images."""
        found = marks_at(len(marked), self.roots[marked[self.members]])
        out = marked.copy()
        out[self.members] |= found[self.roots]
        return out

    def images(self, positions: Floats) -> Floats:
        """Positions (p, d) of the members when their roots are at ``positions`` (p, d)."""
        origin, own = self.reference[self.roots], self.reference[self.members]
        step = np.einsum("pij,pj->pi", self.projectors, positions - origin)
        turned = np.einsum("pij,pj->pi", self.rotations, step)
        straight = (self.rotations == np.eye(own.shape[1])).all(axis=2)
        straight &= (self.projectors == np.eye(own.shape[1])).all(axis=2)
        return np.where(straight & (origin == own), positions, own + turned)

    def carry(self, origin: Floats, goal: Floats) -> RigidMotion | None:
        """The rigid motion of the whole domain that takes control points from origin closest to goal (k, d).

        The mean translation; with a period that rotates, the mean screw about its axis. None if the periods rotate
        about several axes.
        """
        turning = next((generator for generator in self.generators if generator.turns), None)
        if turning is not None:
            found = fit_screw(origin, goal, turning)
            return found if all(_commute(found, generator, origin) for generator in self.generators) else None
        shift = np.asarray((goal - origin).mean(axis=0))
        return RigidMotion(np.zeros(len(shift)), shift, 0.0, np.array([0.0, 0.0, 1.0]))

    def check_targets(self, moving: Integers, targets: Floats) -> None:
        """Refuse targets (k, d) of the moving nodes (k,) that separate a pair.

        Raises InvalidInput naming the first such node, its image and the distance.
        """
        moved = self.reference.copy()
        moved[moving] = targets
        pairs = self.of(np.isin(self.members, moving))
        away = np.linalg.norm(moved[pairs.members] - pairs.images(moved[pairs.roots]), axis=1)
        torn = np.flatnonzero(away > _TORN * float(np.ptp(self.reference, axis=0).max()))
        if len(torn):
            node, root = int(pairs.members[torn[0]]), int(pairs.roots[torn[0]])
            raise InvalidInput(
                f"the displacements of node {node} and of node {root}, its periodic image, differ by "
                f"{away[torn[0]]:.3g}; expected the same, turned with the period where that is a rotation",
                code="INVALID_ARGUMENT.VALUE",
                hint="give the image of a node the same displacement as the node",
                details={"node": node, "image": root, "distance": float(away[torn[0]])},
            )

    def check_kinds(self, kinds: Mapping[str, Integers]) -> None:
        """Refuse an orbit whose nodes have different kinds.

        Raises InvalidInput naming the first such node, and its image.

        Parameters
        ----------
        kinds : dict of int64 arrays
            Disjoint nodes by kind: moving, fixed, sliding; the others are periodic only.
        """
        names = ["periodic", *kinds]
        kind = np.zeros(len(self.reference), dtype=np.int64)
        for number, nodes in enumerate(kinds.values(), start=1):
            kind[nodes] = number
        odd = np.flatnonzero(kind[self.members] != kind[self.roots])
        if len(odd):
            node, root = int(self.members[odd[0]]), int(self.roots[odd[0]])
            raise InvalidInput(
                f"node {node} is {names[kind[node]]} but node {root}, its periodic image, is {names[kind[root]]}; "
                "the two would not remain a pair",
                code="INVALID_ARGUMENT.MESH",
                hint="put both on a patch of the same role: a patch that ends at a periodic side has an image there",
                details={"node": node, "image": root},
            )


def _commute(motion: RigidMotion, generator: Transform, points: Floats) -> bool:
    """Whether points (k, d) that are moved, and their images, stay images of each other, within 1e-9 of the extent."""
    apart = motion.apply(generator(points)) - generator(motion.apply(points))
    return bool(np.abs(apart).max() <= _UNCHANGED * np.abs(motion.apply(points) - motion.centre).max())


def _orbit(root: int, links: Mapping[int, list[tuple[int, Transform]]], d: int) -> tuple[dict[int, Floats], Floats]:
    """Rotation from the root to each node of its orbit, and projector onto vectors that all cycles leave unchanged."""
    found = {root: np.eye(d)}
    round_trips = [np.zeros((1, d))]
    queue = [root]
    for node in queue:  # the list grows during the loop
        for other, transform in links[node]:
            turned = transform.rotation @ found[node] if transform.turns else found[node]
            if other not in found:
                found[other] = turned
                queue.append(other)
            elif not np.allclose(turned, found[other], atol=_UNCHANGED):
                round_trips.append(found[other].T @ turned - np.eye(d))
    if len(round_trips) == 1:
        return found, np.eye(d)
    _, sizes, directions = np.linalg.svd(np.vstack(round_trips))
    kept = directions[sizes <= _UNCHANGED]
    return found, kept.T @ kept
