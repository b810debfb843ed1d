"""A model with hardly any computation, for tests of sessions in which the motion does not matter."""

from types import SimpleNamespace

import numpy as np
from mesh_motion_numerics.mesh.roles import BoundaryRoles
from mesh_motion_numerics.quality.headroom import Headroom
from mesh_motion_numerics.quality.quality_summary import Distribution, QualitySummary
from mesh_motion_protocol.errors import InvalidInput, QualityRefused

_PARTS = ("solve", "predict", "correct", "displace", "total")


class PlainModel:
    """A model whose moving nodes go to their targets, while the others stay; all summaries are equal."""

    warnings = ()
    #: Displacements beyond this are refused, mesh length unit.
    farthest = 10.0
    #: The warning of every motion.
    motion_warnings = ()

    def __init__(self, points, cells, patches, method):
        self.roles, self.method, self.cells = BoundaryRoles.from_patches(patches), method, cells

    def summary(self, points):
        values = Distribution(1.0, 1.0, 1.0, 1.0, 1.0)
        count = sum(len(block) for block in self.cells)
        return QualitySummary(values, values, values, values, 0, count, ())

    def headroom(self, before, points, worst, *, step=True):
        return Headroom(8.5, 4.25, 0)

    def why_no_slope(self):
        if self.method.displacement != "absolute":
            return InvalidInput("displacement", code="FAILED_PRECONDITION", details={"setting": "displacement"})
        return None

    def slope(self, points, factors):
        moving = self.roles.moving

        def tangent(velocity):
            found = np.zeros_like(points)
            found[moving] = velocity
            return found

        return SimpleNamespace(tangent=tangent, cotangent=lambda weights: weights[moving])

    def without_distributions(self):
        return self

    def move(self, committed, targets, factors, *, boundary_displacement=None):
        displacement = targets - committed[self.roles.moving]
        if abs(displacement).max() > self.farthest:
            raise QualityRefused("too far", best=-0.5, cells=[1, 0], fraction=0.25, hint="move less")
        points = committed + self.of_all(displacement)
        points[self.roles.moving] = targets
        return SimpleNamespace(
            points=points,
            standard=self.summary(points),
            corrected=self.summary(points),
            correction=SimpleNamespace(
                method="none", enrichment_points=np.zeros((0, points.shape[1])), freed_nodes=0, iterations=0
            ),
            reached=True,
            seconds=dict.fromkeys(_PARTS, 0.0),
            caches={"factorization": "made"},
            control_points=np.arange(len(committed)),
            support_radius=1.0,
            sub_steps=1,
            warnings=list(self.motion_warnings),
            field=None,
        )

    def of_all(self, displacement):
        """(d,) displacement of the other nodes, from that of the moving ones (k, d)."""
        return np.zeros(displacement.shape[1])
