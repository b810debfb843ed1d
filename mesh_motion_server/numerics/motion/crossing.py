"""Motions for which no valid mesh exists, because the boundary crosses itself or is turned inside out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mesh_motion_server.errors import NumericalError
from mesh_motion_server.numerics.arrays import Floats, Integers
from mesh_motion_server.numerics.mesh.boundary_crossing import BoundaryFacets, crossing_place
from mesh_motion_server.numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_server.numerics.mesh.boundary_orientation import overturned_place
from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.numerics.mesh.coincidence import CoincidentSides
from mesh_motion_server.numerics.mesh.roles import BoundaryRoles
from mesh_motion_server.numerics.motion.boundary_nesting import misplaced_place

__all__ = ["PossibleCrossing"]


@dataclass(frozen=True, eq=False)
class PossibleCrossing:
    """The boundary of a mesh, which may cross itself.

    Attributes
    ----------
    reference : (n, d) array, mesh length unit
        Reference coordinates.
    sides : CoincidentSides
        Of nodes with prescribed positions.
    """

    reference: Floats
    cells: CellTable
    roles: BoundaryRoles
    facets: BoundaryFacets
    sides: CoincidentSides

    @classmethod
    def build(cls, reference: Floats, cells: CellTable, roles: BoundaryRoles, coincident: Integers) -> PossibleCrossing:
        """Build it for a checked mesh with ``coincident`` (c, 2) nodes."""
        facets, known = boundary_facets(cells), np.zeros(len(reference), dtype=bool)
        known[roles.moving] = known[roles.fixed] = True
        own = BoundaryFacets.build(facets, roles.moving, roles.fixed, len(reference))
        return cls(reference, cells, roles, own, CoincidentSides.build(coincident, facets, known))

    def refuse_passing(self, points: Floats, targets: Floats, refusal: NumericalError | None = None) -> None:
        """Refuse it if two nodes at the same place in the reference mesh pass through each other: as below."""
        if not len(self.sides.pairs):
            return
        moved = points.copy()
        moved[self.roles.moving] = targets
        pair = self.sides.passing(moved)
        if pair is not None:
            one, other = pair
            fault = f"pass through itself at node {one} and node {other}, which are at the same place at rest"
            raise _no_mesh(fault, refusal, {"node": one})

    def refuse(self, points: Floats, targets: Floats, refusal: NumericalError | None = None) -> None:
        """Refuse the mesh ``points`` (n, d) with its moving nodes at ``targets`` (k, d) if no valid mesh exists.

        Raises
        ------
        NumericalError
            With the best quality, the worst cells and the details of an earlier ``refusal``.
        """
        self.refuse_passing(points, targets, refusal)
        moved, prescribed = points.copy(), np.zeros(len(points), dtype=bool)
        moved[self.roles.moving] = targets
        prescribed[self.roles.moving] = prescribed[self.roles.fixed] = True
        place, fault = crossing_place(self.facets, moved), "cross itself"
        if place is None:
            facets = boundary_facets(self.cells)
            place, fault = overturned_place(facets, prescribed, self.reference, moved), "turn inside out"
            if place is None:
                place = misplaced_place(facets, prescribed, self.roles.moving, self.reference, moved)
                fault = "leave its side of another part"
        if place is None:
            return
        near = ", ".join(f"{x:.4g}" for x in place)
        raise _no_mesh(f"{fault} near ({near})", refusal)


def _no_mesh(fault: str, refusal: NumericalError | None, details: Mapping[str, object] | None = None) -> NumericalError:
    """The error for a boundary with this fault, with what an earlier refusal found."""
    known = refusal or NumericalError("")
    return NumericalError(
        f"no valid mesh exists: the boundary would {fault}",
        best=known.best,
        cells=known.cells,
        details={**known.details, **(details or {})},
    )
