"""Moving nodes on a plane wall: where a body or a piston ends at a symmetry or slip plane, it must stay on the plane.

Away from the plane it would leave a gap in the boundary, or enter the domain's mirror image. The quality of no cell
shows this.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.points import bounding_box
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.mesh.smooth_pieces import smooth_pieces

#: Nodes this close to their plane are on it, relative to the domain's extent (single-precision displacements).
_ON_PLANE = 1e-6


@dataclass(frozen=True, eq=False)
class PlaneRims:
    """The moving nodes on the plane walls of a mesh."""

    moving: Integers  # (k,)
    places: Floats  # (k, d), mesh length unit. Places of the moving nodes in the reference mesh
    closest: float  # mesh length unit. A node at most this far from its plane is on it
    #: tuple of (patch, role, rows, normal). Rows (r,) of the moving nodes on one plane, and its unit normal (d,).
    rims: tuple[tuple[str, str, Integers, Floats], ...]
    #: tuple of (patch, role, corners, normal). For each plane the corners (2, d) of the box around its nodes, and its
    #: unit normal (d,).
    planes: tuple[tuple[str, str, Floats, Floats], ...]

    @classmethod
    def build(
        cls,
        points: Floats,
        facets: Mapping[str, Integers],
        patches: Mapping[str, Patch],
        surfaces: Mapping[str, Integers],
        moving: Integers,
    ) -> PlaneRims | None:
        """Find the rims in a mesh with reference ``points`` (n, d) and the ``facets`` (f, k) of its whole boundary.

        ``surfaces``: the nodes of the :func:`.whole_walls`. None if no wall is plane.
        """
        rims, planes = [], []
        for name, nodes in surfaces.items():
            role = patches[name].role
            for piece in smooth_pieces(points, facets, nodes):
                if piece.normal is None:
                    continue
                planes.append((name, role, bounding_box(points[piece.nodes]), piece.normal))
                rows = np.flatnonzero(np.isin(moving, piece.nodes))
                if len(rows):
                    rims.append((name, role, rows, piece.normal))
        if not planes:
            return None
        return cls(moving, points[moving], _ON_PLANE * float(np.ptp(points, axis=0).max()), tuple(rims), tuple(planes))

    def check(self, targets: Floats) -> list[str]:
        """Refuse targets (k, d) of the moving nodes that leave a symmetry plane; warn of those that leave a slip wall.

        Raises InvalidInput naming the patch, its node farthest from the plane and the distance.
        """
        warnings = []
        for name, role, rows, normal in self.rims:
            away = np.abs((targets[rows] - self.places[rows]) @ normal)
            farthest = int(np.argmax(away))
            node, distance = int(self.moving[rows[farthest]]), float(away[farthest])
            if not distance > self.closest:
                continue
            if role == "symmetry":
                raise InvalidInput(
                    f"moving node {node} leaves the plane of the symmetry patch {name!r}: it would be {distance:.3g} "
                    f"off, expected at most {self.closest:.3g}",
                    code="INVALID_ARGUMENT.VALUE",
                    hint="move the nodes of a symmetry plane within that plane, or give that patch the role slip",
                    details={"patch": name, "node": node, "distance": distance},
                )
            warnings.append(f"moving node {node} leaves the plane of the slip patch {name!r}: it is {distance:.3g} off")
        return warnings

    def passed(self, targets: Floats) -> str:
        """The plane that moving nodes pass on the straight line to targets (k, d), for a message; "" if none."""
        for name, role, box, normal in self.planes:
            before, after = ((places - box[0]) @ normal for places in (self.places, targets))
            through = np.flatnonzero((before * after < 0.0) & (np.minimum(abs(before), abs(after)) > self.closest))
            share = (before[through] / (before[through] - after[through]))[:, None]
            places = self.places[through] + share * (targets - self.places)[through]
            inside = ((box[0] - self.closest <= places) & (places <= box[1] + self.closest)).all(axis=1)
            if inside.any():
                return f"; node {int(self.moving[through[inside][0]])} passes the plane of the {role} patch {name!r}"
        return ""
