"""The multi-step interpolation of Floater and Iske: from coarse to fine, each level on the error of the previous one.

    X_1 ⊂ X_2 ⊂ …        nested subsets of the boundary nodes, each well separated
    s_k on X_k            interpolates the displacement minus s_1 + … + s_(k−1), with the support radius R / 2^(k−1)

A level takes the nodes of the farthest-first order whose separation is at least its radius over :data:`SPACINGS`. So
the matrices of all levels have about the same row length and condition, for any number of
nodes. The levels end when the tolerance is met, or when a level has all nodes: then no error is left (thesis §2.2.1,
Fig 2.4).

References
----------
M. S. Floater, A. Iske, "Multistep scattered data interpolation using compactly supported radial basis functions",
J. Comput. Appl. Math. 73 (1996) 65–78; thesis [21].
"""

import numpy as np
from mesh_motion_numerics.reduction.problem import Reduced, ReductionProblem

from docs.studies.thesis._point_reduction.farthest_first import farthest_first
from docs.studies.thesis._point_reduction.level_sum import LevelSum

__all__ = ["SPACINGS", "reduce"]

SPACINGS = 8.0
"""Support radius of a level over the separation of its nodes.

With 4, as is usual for plain interpolation, the first level holds a small body by two or three nodes, and narrower
levels carry its motion: around a thin ellipse the minimum size-skew is then 0.12, with 8 0.37, with 16 0.48, from all
nodes 0.48; each doubling doubles to quadruples the work.
"""


def reduce(problem: ReductionProblem) -> Reduced:
    """Add levels of half the radius until the tolerance is met.

    Raises
    ------
    InvalidInput
        If the basis has no compact support.
    """
    field = LevelSum(problem)
    field.require_compact("multi-step")
    nodes = farthest_first(problem.points, np.array([problem.start]))
    radius, before = problem.support_radius, 0
    while True:
        count = min(int((nodes.separation >= radius / SPACINGS).sum()), problem.limit)
        if count > before and field.add(nodes.order[:count], radius):
            return field.reduced()
        radius, before = radius / 2.0, count
