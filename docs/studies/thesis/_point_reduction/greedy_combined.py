"""One-point corrections with a full solution after every ten points (thesis §2.2.2, Fig 2.6).

The corrections choose the points cheaply; the regular full solutions prevent an accumulation of their errors. Solutions
cost a tenth of the full algorithm's, and all errors are recomputed a tenth as often.

References
----------
T. C. S. Rendall, C. B. Allen, J. Comput. Phys. 229 (2010) 2810–2820.
"""

from mesh_motion_numerics.reduction.problem import Reduced, ReductionProblem

from docs.studies.thesis._point_reduction.one_point import corrected_reduction

__all__ = ["FULL_EVERY", "reduce"]

FULL_EVERY = 10
"""Points between two full solutions, as in thesis Fig 2.6."""


def reduce(problem: ReductionProblem) -> Reduced:
    """One-point corrections, and a full solution after every :data:`FULL_EVERY` points and at the end."""
    return corrected_reduction(problem, lambda points: points % FULL_EVERY == 0)
