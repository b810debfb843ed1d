"""Several points per iteration: every peak of the error above a share of the largest (Li et al.; thesis Fig 2.7).

A peak is a node whose error no neighbour exceeds, so that one iteration adds points far from each other. With L points
per iteration the full solutions cost ``N_c⁴ / (4 L)`` in the units of thesis Table 2.3, and the errors are computed
only ``N_c / L`` times.

References
----------
C. Li, Q. Xu, D. Xu et al., the thesis' [30]; described in thesis §2.2.3 with (2.11), (2.12) and Fig 2.7.
"""

from functools import partial

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.reduction.problem import Reduced, ReductionProblem

from docs.studies.thesis._point_reduction.greedily import full_solution, greedily
from docs.studies.thesis._point_reduction.peaks import error_peaks, nearest_neighbours

__all__ = ["PEAK_SHARE", "reduce"]

PEAK_SHARE = 0.5
"""Peaks from this share of the largest error on are added."""


def reduce(problem: ReductionProblem, *, share: float = PEAK_SHARE) -> Reduced:
    """Add all peaks above ``share`` of the largest error, solve again, until the tolerance is met."""
    neighbours = nearest_neighbours(problem.points)

    def choose(size: Floats, most: int) -> Integers:
        peaks = error_peaks(size, neighbours)
        chosen: Integers = peaks[size[peaks] >= max(share * size.max(), problem.allowed_error, 0.0)]
        return chosen[:most]

    return greedily(problem, partial(full_solution, problem), choose)
