"""Point reductions that the thesis reviews (§2.2), for comparison with those of the server.

One algorithm per module, all called ``reduce(problem) -> Reduced``; :data:`REDUCTIONS` has these and the server's.
"""

from mesh_motion_numerics.reduction import REDUCTIONS as OFFERED
from mesh_motion_numerics.reduction import repeatable

from docs.studies.thesis._point_reduction import (
    error_peaks,
    greedy,
    greedy_combined,
    grid_clustering,
    incremental_lu,
    multi_step,
    multilevel_subspace,
    multiscale,
    one_point,
    recurrence_cholesky,
)

__all__ = ["REDUCTIONS"]

REDUCTIONS = {
    "greedy": repeatable(greedy.reduce),
    "one-point": repeatable(one_point.reduce),
    "greedy-combined": repeatable(greedy_combined.reduce),
    "error-peaks": repeatable(error_peaks.reduce),
    "incremental-lu": repeatable(incremental_lu.reduce),
    "recurrence-cholesky": repeatable(recurrence_cholesky.reduce),
    "grouped-circular": OFFERED["grouped-circular"],
    "multilevel-subspace": repeatable(multilevel_subspace.reduce),
    "multi-step": repeatable(multi_step.reduce),
    "multiscale": repeatable(multiscale.reduce),
    "grid-clustering": repeatable(grid_clustering.reduce),
}
