"""Motions for which no valid mesh exists, because the boundary crosses itself or is turned inside out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import NumericalError
from mesh_motion_server.numerics.mesh.boundary_crossing import BoundaryFacets, crossing_place
from mesh_motion_server.numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_server.numerics.mesh.boundary_orientation import overturned_place
from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.numerics.mesh.roles import BoundaryRoles

__all__ = ["PossibleCrossing"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PossibleCrossing:
    """The boundary of a mesh, which may cross itself.

    Attributes
    ----------
    reference : (n, d) array, mesh length unit
        Reference coordinates.
    cells : CellTable
    roles : BoundaryRoles
    facets : BoundaryFacets
    """

    reference: Floats
    cells: CellTable
    roles: BoundaryRoles
    facets: BoundaryFacets

    @classmethod
    def build(cls, reference: Floats, cells: CellTable, roles: BoundaryRoles) -> PossibleCrossing:
        """Build it for a checked mesh."""
        facets = BoundaryFacets.build(boundary_facets(cells), roles.moving, roles.fixed, len(reference))
        return cls(reference, cells, roles, facets)

    def refuse(self, points: Floats, targets: Floats, refusal: NumericalError | None = None) -> None:
        """Refuse the mesh ``points`` (n, d) with its moving nodes at ``targets`` (k, d) if no valid mesh exists.

        Raises
        ------
        NumericalError
            With the best quality, the worst cells and the details of an earlier ``refusal``.
        """
        moved, prescribed = points.copy(), np.zeros(len(points), dtype=bool)
        moved[self.roles.moving] = targets
        prescribed[self.roles.moving] = prescribed[self.roles.fixed] = True
        place, fault = crossing_place(self.facets, moved), "cross itself"
        if place is None:
            place = overturned_place(boundary_facets(self.cells), prescribed, self.reference, moved)
            fault = "turn inside out"
        if place is None:
            return
        near = ", ".join(f"{x:.4g}" for x in place)
        known = refusal or NumericalError("")
        raise NumericalError(
            f"no valid mesh exists: the boundary would {fault} near ({near})",
            best=known.best,
            cells=known.cells,
            details=known.details,
        )
