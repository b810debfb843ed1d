"""Several points an iteration: every peak of the error above a share of the largest (Li et al.; thesis Fig 2.7).

A peak is a node whose error no neighbour exceeds, so that one iteration adds points far from each other. With L points
an iteration the full solutions cost ``N_c⁴ / (4 L)`` in the units of thesis Table 2.3, and the errors are formed
``N_c / L`` times only.

References
----------
C. Li, Q. Xu, D. Xu et al., the thesis' [30]; described in thesis §2.2.3 with (2.11), (2.12) and Fig 2.7.
"""

from __future__ import annotations

import numpy as np

from mesh_motion_server.numerics.reduction.full_solve import full_operations, full_weights
from mesh_motion_server.numerics.reduction.peaks import error_peaks, nearest_neighbours
from mesh_motion_server.numerics.reduction.problem import Reduced, ReductionProblem
from mesh_motion_server.numerics.reduction.progress import Progress, lengths

__all__ = ["PEAK_SHARE", "reduce"]

PEAK_SHARE = 0.5
"""Peaks from this share of the largest error on are added."""


def reduce(problem: ReductionProblem, *, share: float = PEAK_SHARE) -> Reduced:
    """Add all peaks above ``share`` of the largest error, solve again, until the tolerance is met."""
    progress = Progress(problem)
    neighbours = nearest_neighbours(problem.points)
    selected = np.array([problem.start])
    while True:
        level = problem.level(selected, full_weights(problem, selected))
        error = problem.displacement - problem.values(level)
        progress.count(solve=full_operations(problem, len(selected)), error=float(problem.n_points) * len(selected))
        if progress.record(len(selected), error):
            return Reduced((level,), selected, error, tuple(progress.history))
        size = lengths(error)
        size[selected] = -1.0  # the error there is only rounding
        peaks = error_peaks(size, neighbours)
        peaks = peaks[size[peaks] >= max(share * size.max(), problem.allowed_error, 0.0)]
        selected = np.concatenate([selected, peaks[: problem.limit - len(selected)]])
