"""Which sets of control nodes of a mesh are interpolated in two scales, and their plans."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.interpolation.kernels import basis_named
from mesh_motion_server.numerics.interpolation.two_scale.factorization import TwoScalePlan
from mesh_motion_server.numerics.mesh.roles import BoundaryRoles
from mesh_motion_server.numerics.method import Method

__all__ = ["AUTOMATIC_FROM", "TwoScalePlans", "plan_for"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

AUTOMATIC_FROM = 1000
"""Control nodes above which the coarse field of the solver "auto" has few of them and is a spline on a grid. With 1300
of them and 98 000 nodes in 2D a step takes a quarter of the time that all of them take, with 5900 and 50 000 in 3D a
twentieth."""


@dataclass(frozen=True, eq=False)
class TwoScalePlans:
    """Plans by the control nodes that they are for.

    Attributes
    ----------
    plans : tuple of (nodes (c,), TwoScalePlan)
    """

    plans: tuple[tuple[Indices, TwoScalePlan], ...]

    @classmethod
    def build(
        cls,
        points: Floats,
        roles: BoundaryRoles,
        method: Method,
        *,
        offered: bool,
        controls: Callable[[Indices], Indices] = np.asarray,
    ) -> TwoScalePlans:
        """Plan for the prescribed nodes of a mesh with reference ``points`` (n, d), and for all that slide too.

        With a boundary layer ``controls`` gives the control nodes that stand for them.

        Nothing is planned where the method reduces the control points or another solver is chosen, where two scales are
        not ``offered``, and where one scale does for all of them.

        Raises
        ------
        InvalidInput
            If the solver "two-scale" is chosen and the support radius is too small for it.
        """
        sets = [controls(nodes) for nodes in (roles.all, roles.prescribed)[: 2 if len(roles.sliding) else 1]]
        if not offered or method.reduction != "none" or method.solver not in ("auto", "two-scale"):
            return cls(())
        if method.solver == "auto" and not basis_named(method.basis).compact:
            return cls(())
        planned = [(nodes, plan_for(points, nodes, roles, method)) for nodes in sets]
        if method.solver == "two-scale":
            for _, plan in planned:
                _require_joined(plan)
        return cls(tuple((nodes, plan) for nodes, plan in planned if plan.usable))

    def with_support_radius(self, radius: float) -> TwoScalePlans:
        """The same with another radius of the coarse field, mesh length unit; without those that it does not suit."""
        others = ((nodes, replace(plan, support_radius=radius)) for nodes, plan in self.plans)
        return TwoScalePlans(tuple((nodes, plan) for nodes, plan in others if plan.usable))

    def of(self, nodes: Indices) -> TwoScalePlan | None:
        """The plan for control nodes (c,), or None: all of them in one scale."""
        return next((plan for planned, plan in self.plans if np.array_equal(planned, nodes)), None)


def plan_for(points: Floats, nodes: Indices, roles: BoundaryRoles, method: Method) -> TwoScalePlan:
    """The plan for control nodes (c,) of the mesh ``points`` (n, d)."""
    return TwoScalePlan.build(
        points[nodes],
        ~np.isin(nodes, roles.fixed),  # what slides moves too
        basis=method.basis,
        support_radius=method.support_radius,
        polynomial=method.polynomial,
        gridded=method.solver == "two-scale" or len(nodes) > AUTOMATIC_FROM,
    )


def _require_joined(plan: TwoScalePlan) -> None:
    if not plan.joined:
        raise InvalidInput(
            f"solver = 'two-scale' needs a support radius of at least {plan.least_radius:.3g} on this mesh, got "
            f"{plan.support_radius or 0.0:.3g}",
            hint="take a larger support_radius, or solver = 'sparse', which is fast for small ones",
        )
