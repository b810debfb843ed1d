"""Motions for which no valid mesh exists, because the boundary crosses itself or is turned inside out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import islice

import numpy as np
from mesh_motion_protocol.errors import QualityRefused

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.boundary_crossing import (
    BoundaryFacets,
    crossing_place,
    near_facets,
    straddling_place,
    touching_facets,
)
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets, boundary_nodes
from mesh_motion_numerics.mesh.boundary_orientation import outer_nodes, overturned_place
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.coincidence import CoincidentSides, linked_by_cells, met_nodes
from mesh_motion_numerics.mesh.points import marks_at, spread
from mesh_motion_numerics.mesh.rigid_transforms import Transform
from mesh_motion_numerics.mesh.roles import BoundaryRoles
from mesh_motion_numerics.mesh.sliding import SlidingSurfaces
from mesh_motion_numerics.motion.boundary_nesting import (
    MOST_BEYOND,
    beyond,
    contact_place,
    left_place,
    misplaced_place,
    passed_place,
)
from mesh_motion_numerics.motion.point_contact import meeting_place


class NoMeshExists(QualityRefused):
    """The boundary forbids every mesh: no correction, way or boundary layer can find one.

    Attributes
    ----------
    looked_for : int
        Number of kinds of faults that were tested until this one was found; 0 for nodes that meet or pass each other.
    """

    looked_for = 0


@dataclass(frozen=True, eq=False)
class PossibleCrossing:
    """The boundary of a mesh, with tests for crossings."""

    reference: Floats  # (n, d), mesh length unit. Reference coordinates
    cells: CellTable
    roles: BoundaryRoles
    #: The facets with known places; a wall whose nodes slide has its reference places if none of its nodes moves.
    facets: BoundaryFacets
    #: (n,) bool. Nodes with known places; includes nodes that slide in a plane, because they do not change its winding
    #: numbers.
    known: Marks
    sides: CoincidentSides  # sides with prescribed positions
    curved: tuple[Integers, ...] = ()  # tuple of (p,). The nodes of each curved wall on which nodes slide
    generators: tuple[Transform, ...] = ()  # those of a periodic domain's images

    @classmethod
    def build(
        cls,
        reference: Floats,
        cells: CellTable,
        roles: BoundaryRoles,
        coincident: Integers,
        sliding: SlidingSurfaces | None = None,
        generators: tuple[Transform, ...] = (),
    ) -> PossibleCrossing:
        """Build it for a checked mesh with ``coincident`` (c, 2) nodes."""
        facets, known = boundary_facets(cells), marks_at(len(reference), roles.moving, roles.fixed)
        sides = CoincidentSides.build(coincident, facets, known)
        still = np.union1d(roles.fixed, _on_planes(sliding, roles.moving))
        own = BoundaryFacets.build(facets, roles.moving, still, len(reference))
        known[_on_planes(sliding, roles.moving[:0])] = True
        curved = () if sliding is None else tuple(piece.nodes for piece in sliding.pieces if piece.normal is None)
        return cls(reference, cells, roles, own, known, sides, curved, generators)

    def refuse_passing(self, points: Floats, targets: Floats, refusal: QualityRefused | None = None) -> None:
        """Refuse a mesh in which two nodes at the same reference place pass through each other; errors as below."""
        if not len(self.sides.pairs):
            return
        moved = points.copy()
        moved[self.roles.moving] = targets
        pair = self.sides.passing(moved)
        if pair is not None:
            one, other = pair
            fault = f"pass through itself at node {one} and node {other}, which are at the same place at rest"
            raise _no_mesh(fault, refusal, {"node": one})

    def refuse_overlap(self, points: Floats, targets: Floats, refusal: QualityRefused) -> None:
        """Refuse a mesh that would overlap itself from outside, although no cell need be inverted; errors as below.

        Two arms of the domain, for example, with a solid between them. A hole that is closed inverts cells.
        """
        if self.outer is not None:
            place = crossing_place(self.outer, self._moved(points, targets))
            if place is not None:
                raise _no_mesh("cross itself", refusal, place=place, looked_for=1)

    @cached_property
    def outer(self) -> BoundaryFacets | None:
        """The facets of outer parts of the boundary; None if none of them moves, or if sides touch or cross at rest."""
        if not self.facets.nodes or len(self.sides.pairs):
            return None
        outer = outer_nodes(boundary_facets(self.cells), self.reference)
        if not outer[self.roles.moving].any():
            return None
        chosen = {name: nodes[outer[nodes[:, 0]]] for name, nodes in self.facets.nodes.items()}
        found = BoundaryFacets({name: nodes for name, nodes in chosen.items() if len(nodes)}, self.facets.moving)
        return found if crossing_place(found, self.reference) is None else None

    def refuse(self, points: Floats, targets: Floats, refusal: QualityRefused | None = None) -> None:
        """Refuse the mesh ``points`` (n, d) with its moving nodes at ``targets`` (k, d) if no valid mesh exists.

        Raises NoMeshExists; the error has the best quality, the worst cells and the details of an earlier ``refusal``.
        """
        self.refuse_passing(points, targets, refusal)
        moved = self._moved(points, targets)
        self._refuse_meeting(moved, refusal)
        for count, (fault, place) in enumerate(self._faults(moved), 1):
            if place is not None:
                raise _no_mesh(fault, refusal, place=place, looked_for=count)

    def has_fault(self, points: Floats, targets: Floats, most: int) -> bool:
        """Whether one of the first ``most`` kinds of faults exists: testing all kinds takes longer."""
        faults = islice(self._faults(self._moved(points, targets)), most)
        return any(place is not None for _, place in faults)

    def _moved(self, points: Floats, targets: Floats) -> Floats:
        """The mesh ``points`` (n, d) with its moving nodes at ``targets`` (k, d) and its sliding nodes at rest."""
        moved = points.copy()
        moved[self.roles.sliding] = self.reference[self.roles.sliding]
        moved[self.roles.moving] = targets
        return moved

    def _refuse_meeting(self, moved: Floats, refusal: QualityRefused | None) -> None:
        """Refuse nodes of ``moved`` (n, d) that meet and have cells between them, unlike the sides of a thin solid."""
        pairs = met_nodes(self.reference, moved, self.roles.prescribed)
        inside = ~np.isin(pairs, self._boundary_nodes).all(axis=1)
        for one, other in pairs[inside | linked_by_cells(self.cells, pairs, len(moved))][:1].tolist():
            fault = f"bring node {one} and node {other} to the same place, which are apart at rest"
            raise _no_mesh(fault, refusal, {"node": one})

    @cached_property
    def _boundary_nodes(self) -> Integers:
        """(b,) nodes of the boundary facets, ascending."""
        return boundary_nodes(self.cells)

    def _faults(self, moved: Floats) -> Iterator[tuple[str, Floats | None]]:
        """Yield each fault of a boundary with its nodes at ``moved`` (n, d), and a place (d,) of the fault."""
        near = near_facets(self.facets, moved)
        yield "cross itself", crossing_place(self.facets, moved, near)
        facets, reference = boundary_facets(self.cells), self.reference
        yield "turn inside out", overturned_place(facets, self.known, reference, moved)
        misplaced = misplaced_place(facets, self.known, self.roles.moving, reference, moved)
        yield "leave its side of another part", misplaced
        if not len(self.sides.pairs):  # sides that touch at rest would cross after a small shift
            yield "cross itself", straddling_place(self.facets, moved, near)
        touching = touching_facets(self.facets, moved, near)
        yield "touch or cross itself", contact_place(facets, touching, self.known, reference, moved)
        yield "touch or cross itself", meeting_place(facets, touching, moved)
        if not len(self.sides.pairs):
            left = left_place(facets, self.known, self.roles.moving, reference, moved)
            yield "leave its side of another part", left
        if self.curved and not len(self.roles.periodic):
            known, moving = self.known.copy(), self.roles.moving
            known[self.roles.sliding] = True
            around = [np.concatenate([reference[wall], moved[wall]]) for wall in self.curved]
            some = spread(moving, MOST_BEYOND)
            out = some[beyond(moved[some][:, None], around)]
            misplaced = misplaced_place(facets, known, out, reference, moved)
            yield "leave its side of another part", misplaced
            yield "leave its side of another part", left_place(facets, known, moving, reference, moved, around)
        if len(self.roles.periodic):
            # periodic sides bend, and a body may pass beyond them; but a fixed wall separates them
            still = touching[~(self.facets.moving[touching] & (touching >= 0)).any(axis=1)]
            known = self.known.copy()
            known[self.roles.periodic] = True
            yield "touch or cross itself", contact_place(facets, still, known, reference, moved)
            yield "leave its side of another part", self._passed_place(moved)

    def _passed_place(self, moved: Floats) -> Floats | None:
        """The :func:`.passed_place` of a mesh all of whose walls have a role."""
        roles = self.roles
        if not np.isin(self._boundary_nodes, np.concatenate([roles.all, roles.periodic])).all():
            return None
        moving, still = marks_at(len(moved), roles.moving), marks_at(len(moved), roles.fixed, roles.sliding)
        facets = boundary_facets(self.cells)
        return passed_place(facets, moving, still, self.generators, self.reference, moved)


def refuse_region(
    cells: CellTable, moving: Integers, held: Integers, reference: Floats, positions: Floats, refusal: QualityRefused
) -> None:
    """The same as :meth:`PossibleCrossing.refuse` in a part of a mesh: for facets that go through each other, and for
    nodes that leave their side of a boundary part that is complete there. Raises NoMeshExists; the error has the best
    quality, the worst cells and the details of the ``refusal``.

    Parameters
    ----------
    moving, held : (k,), (h,) int64 arrays
        Moving nodes; all nodes on patches. A facet of these nodes between two cells, one of which is outside the part,
        must not cross others either.
    reference, positions : (n, d) arrays, mesh length unit
    """
    facets, known = boundary_facets(cells), marks_at(len(positions), held)
    own = BoundaryFacets.build(facets, moving, held, len(positions))
    for fault, place in (
        ("cross itself", crossing_place(own, positions)),
        ("leave its side of another part", misplaced_place(facets, known, moving, reference, positions)),
    ):
        if place is not None:
            raise _no_mesh(fault, refusal, place=place) from refusal


def _on_planes(sliding: SlidingSurfaces | None, away: Integers) -> Integers:
    """(s,) nodes that slide only in planes, on pieces without a node of ``away``."""
    if sliding is None:
        return np.empty(0, dtype=np.int64)
    others = [p.nodes for p in sliding.pieces if p.normal is None or np.isin(away, p.nodes).any()]
    return np.setdiff1d(sliding.nodes, np.concatenate([away[:0], *others]))


def _no_mesh(
    fault: str,
    refusal: QualityRefused | None,
    details: Mapping[str, object] | None = None,
    *,
    place: Floats | None = None,
    looked_for: int = 0,
) -> NoMeshExists:
    """Return the error for a boundary with this fault, near a place (d,), with the results of an earlier refusal."""
    known = refusal or QualityRefused("")
    near = "" if place is None else f" near ({', '.join(f'{x:.4g}' for x in place)})"
    certain = NoMeshExists(
        f"no valid mesh exists: the boundary would {fault}{near}",
        best=known.best,
        cells=known.cells,
        details={**known.details, **(details or {})},
    )
    certain.looked_for = looked_for
    return certain
