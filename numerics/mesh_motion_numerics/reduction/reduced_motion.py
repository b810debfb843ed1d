"""The interpolation of one motion from few control points, exact at all of them: reduction and near-surface correction.

Connects the point reductions (:mod:`.reduction`) with the standard motion: from the method's keys it makes interpolants
whose sum is the displacement.

If only the boundary nodes are set to their targets, the whole error goes into the first layer of cells, and inverts a
boundary layer that is thinner than the error. So the error is interpolated too, from all boundary nodes, with a compact
function of small support: the matrix is sparse, the field vanishes a few boundary spacings away, it is smooth and has
the same gradient as any interpolant. Then the nodes are set.

The radius is four spacings of the moving boundary. It is doubled until it is ten times the largest error, so that the
gradient of the correction stays below about a fifth; it is at most the support radius of the motion itself. Because it
is doubled, similar displacements share a factorization.

Measured, minimum size-skew of the cells at the moving surface. "decay": the error of the nearest boundary node times
φ(distance / r), the cheap correction of the literature, which has a jump wherever the nearest node changes.

===================================  =======  =========  =========  ==========  ==========  ===========
case, tolerance                      full     nodes set  r = 4 h    r = 8 h     decay 4 h   decay 20 ε
===================================  =======  =========  =========  ==========  ==========  ===========
thin ellipse, 0.0004 layers, 3e-2    0.609    −0.980     0.604      0.603       0.599       0.597
the same, 1e-2                       0.609    −0.973     0.610      0.609       0.603       0.603
the same, 1e-3                       0.609    0.482      0.610      0.610       0.610       0.604
wing without layers, 3e-2            0.292    0.270      0.277      0.285       0.276       0.280
the same, 1e-2                       0.292    0.287      0.290      0.292       0.288       0.288
the same, 1e-3                       0.292    0.294      0.293      0.292       0.293       0.294
===================================  =======  =========  =========  ==========  ==========  ===========

References
----------
L. Kedward, C. B. Allen, T. C. S. Rendall, J. Comput. Phys. 345 (2017) 732–751 (thesis [28]), too make all boundary
nodes exact by functions of small support.
"""

from dataclasses import replace

import numpy as np

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.interpolation.factor_source import FactorSource, factorization_of
from mesh_motion_numerics.mesh.neighbours import local_spacing
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.reduction import REDUCTIONS, Reduced, ReductionProblem

#: An error below this share of the largest displacement is rounding: setting the nodes removes it.
_ROUNDING = 1e-12
BASIS = "wendland-c2"
"""The correction's basis for every basis of the motion: compact, positive definite, with a gradient at its centres."""

_SPACINGS, _ERRORS = 4.0, 10.0


def interpolate_reduced(
    points: Floats, displacement: Floats, method: Method, factors: FactorSource, *, spacing: float
) -> Reduced:
    """Interpolate the displacement of boundary nodes from few of them; the levels give all of them, to rounding.

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
    problem = ReductionProblem(points, displacement, basis=method.basis, support_radius=radius)
    reduced = REDUCTIONS[method.reduction](problem)
    left = reduced.max_error
    if left <= _ROUNDING * problem.largest:
        return reduced
    widest = radius if problem.row.compact else float(np.ptp(points, axis=0).max())
    near = replace(method, basis=BASIS, support_radius=near_surface_radius(spacing, left, widest))
    factorization = factorization_of(points, near, factors)
    return replace(reduced, levels=(*reduced.levels, factorization.solve(reduced.error)))


def boundary_spacing(points: Floats) -> float:
    """Median distance of (n, d) points to their nearest neighbours, mesh length unit; 0 for a single point."""
    if len(points) < 2:
        return 0.0
    return float(np.median(local_spacing(points)))


def near_surface_radius(spacing: float, largest_error: float, widest: float) -> float:
    """Support radius of the correction, mesh length unit.

    Parameters
    ----------
    spacing : float, mesh length unit
        Spacing of the moving boundary; 0 if there is none.
    largest_error : float, mesh length unit
        Largest remaining error at a boundary node.
    widest : float, mesh length unit
        The support radius of the motion, or the extent of the boundary if its basis has none.
    """
    radius = _SPACINGS * spacing if spacing > 0.0 else widest
    while radius < _ERRORS * largest_error and radius < widest:
        radius *= 2.0
    return min(radius, widest)
