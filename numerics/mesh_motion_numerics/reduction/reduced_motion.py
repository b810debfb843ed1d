"""The interpolation of one motion from few control points, exact at all of them: reduction and near-surface correction.

Connects the point reductions (:mod:`.reduction`) with the standard motion: from the method's keys it makes interpolants
whose sum is the displacement.
"""

from dataclasses import dataclass, replace

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.interpolation.factor_source import FactorSource, factorization_of
from mesh_motion_numerics.interpolation.two_scale.interpolant import AnyInterpolant
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.reduction import REDUCTIONS, ReductionProblem
from mesh_motion_numerics.reduction.near_surface import BASIS, near_surface_radius

__all__ = ["ReducedInterpolation", "interpolate_reduced"]


#: An error below this share of the largest displacement is rounding: setting the nodes removes it.
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class ReducedInterpolation:
    """Interpolants whose sum is the displacement, at all boundary nodes to rounding."""

    levels: tuple[AnyInterpolant, ...]  # levels of the reduction, then the near-surface correction if an error remains
    selected: Integers  # (nc,). Rows of the boundary that the reduction chose, in their order


def interpolate_reduced(
    points: Floats, displacement: Floats, method: Method, factors: FactorSource, *, spacing: float
) -> ReducedInterpolation:
    """Interpolate the displacement of boundary nodes from few of them.

    Parameters
    ----------
    points, displacement : (nb, d) arrays, mesh length unit
    method : Method
        The method with its support radius set.
    factors : FactorSource
        Keeps the factorization of the near-surface correction.
    spacing : float, mesh length unit
        Spacing of the moving boundary.
    """
    radius = float(method.support_radius or 1.0)
    problem = ReductionProblem(
        points,
        displacement,
        basis=method.basis,
        support_radius=radius,
    )
    reduced = REDUCTIONS[method.reduction](problem)
    left = reduced.max_error
    if left <= _ROUNDING * problem.largest:
        return ReducedInterpolation(reduced.levels, reduced.selected)
    widest = radius if problem.row.compact else float(np.ptp(points, axis=0).max())
    near = replace(method, basis=BASIS, support_radius=near_surface_radius(spacing, left, widest))
    factorization = factorization_of(points, near, factors)
    levels = (*reduced.levels, factorization.solve(reduced.error))
    return ReducedInterpolation(levels, reduced.selected)
