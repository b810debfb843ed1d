"""The sets of control nodes of a mesh that are interpolated in two scales, and their plans."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.interpolation.kernels import basis_named
from mesh_motion_numerics.interpolation.two_scale.factorization import TwoScalePlan
from mesh_motion_numerics.mesh.roles import BoundaryRoles
from mesh_motion_numerics.method import Method

__all__ = ["AUTOMATIC_FROM", "plan_for", "plans_for"]


AUTOMATIC_FROM = 1000
"""Number of control nodes above which the coarse field has few of them and is a spline on a grid. With 1300 control
nodes and 98 000 nodes in 2D a step takes a quarter of the time with all of them, with 5900 and 50 000 in 3D a
twentieth."""


def plans_for(
    points: Floats, sets: Sequence[Integers], roles: BoundaryRoles, method: Method
) -> dict[bytes, TwoScalePlan]:
    """The plans of those of the ``sets`` of control nodes (c,) that need two scales, by the bytes of the nodes.

    ``points`` (n, d) are those of the mesh. There is no plan if the method reduces the control points or its basis is
    not compact.
    """
    if method.reduction != "none" or not basis_named(method.basis).compact:
        return {}
    planned = {nodes.tobytes(): plan_for(points, nodes, roles, method) for nodes in sets}
    return {nodes: plan for nodes, plan in planned.items() if plan.usable}


def plan_for(points: Floats, nodes: Integers, roles: BoundaryRoles, method: Method) -> TwoScalePlan:
    """Make the plan for control nodes (c,) of the mesh ``points`` (n, d)."""
    return TwoScalePlan.build(
        points[nodes],
        ~np.isin(nodes, roles.fixed),  # sliding nodes also move
        basis=method.basis,
        support_radius=method.support_radius,
        gridded=len(nodes) > AUTOMATIC_FROM,
    )
