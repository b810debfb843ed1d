"""The sets of control nodes of a mesh that are interpolated in two scales, and their plans."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.interpolation.kernels import basis_named
from mesh_motion_numerics.interpolation.two_scale.factorization import TwoScalePlan
from mesh_motion_numerics.mesh.roles import BoundaryRoles
from mesh_motion_numerics.method import Method

__all__ = ["AUTOMATIC_FROM", "TwoScalePlans", "plan_for"]


AUTOMATIC_FROM = 1000
"""Number of control nodes above which the coarse field has few of them and is a spline on a grid. With 1300 control
nodes and 98 000 nodes in 2D a step takes a quarter of the time with all of them, with 5900 and 50 000 in 3D a
twentieth."""


@dataclass(frozen=True, eq=False)
class TwoScalePlans:
    """Plans by their control nodes.

    Attributes
    ----------
    plans : tuple of (nodes (c,), TwoScalePlan)
    """

    plans: tuple[tuple[Integers, TwoScalePlan], ...]

    @classmethod
    def build(
        cls,
        points: Floats,
        roles: BoundaryRoles,
        method: Method,
        *,
        offered: bool,
        followed: Sequence[Integers] = (),
        controls: Callable[[Integers], Integers] = np.asarray,
    ) -> TwoScalePlans:
        """Plan for all nodes with a role of a mesh with reference ``points`` (n, d), and for further sets of nodes.

        ``followed``: the sets of nodes (k,) that sliding nodes follow.

        With a boundary layer ``controls`` returns the control nodes that replace them.

        There is no plan if the method reduces the control points, if two scales are not ``offered``, or if one scale is
        enough for all of them.
        """
        sets = [controls(nodes) for nodes in (roles.all, *followed)]
        if not offered or method.reduction != "none" or not basis_named(method.basis).compact:
            return cls(())
        planned = [(nodes, plan_for(points, nodes, roles, method)) for nodes in sets]
        return cls(tuple((nodes, plan) for nodes, plan in planned if plan.usable))

    def of(self, nodes: Integers) -> TwoScalePlan | None:
        """The plan for control nodes (c,), or None: all of them in one scale."""
        for planned, plan in self.plans:
            if np.array_equal(planned, nodes):
                return plan
        return None


def plan_for(points: Floats, nodes: Integers, roles: BoundaryRoles, method: Method) -> TwoScalePlan:
    """Make the plan for control nodes (c,) of the mesh ``points`` (n, d)."""
    return TwoScalePlan.build(
        points[nodes],
        ~np.isin(nodes, roles.fixed),  # sliding nodes also move
        basis=method.basis,
        support_radius=method.support_radius,
        gridded=len(nodes) > AUTOMATIC_FROM,
    )
