"""Point reduction: the displacement of a boundary from few of its nodes (thesis §2.2).

One algorithm per module, all called ``reduce(problem) -> Reduced``; :data:`REDUCTIONS` chooses by name. The error that
remains at the boundary nodes is in ``Reduced.error``.
"""

from collections.abc import Callable
from functools import wraps

from mesh_motion_numerics.blas import one_blas_thread
from mesh_motion_numerics.reduction import (
    error_peaks,
    greedy,
    greedy_combined,
    grid_clustering,
    grouped_circular,
    incremental_lu,
    multi_step,
    multilevel_subspace,
    multiscale,
    one_point,
    recurrence_cholesky,
)
from mesh_motion_numerics.reduction.problem import Iterate, Level, Reduced, ReductionProblem

__all__ = ["REDUCTIONS", "Iterate", "Level", "Reduced", "ReductionProblem"]

Reduction = Callable[[ReductionProblem], Reduced]


def _repeatable(reduce: Reduction) -> Reduction:
    """The algorithm, bitwise the same for any number of threads."""

    @wraps(reduce)
    def run(problem: ReductionProblem) -> Reduced:
        with one_blas_thread():
            return reduce(problem)

    return run


#: Every algorithm by its name in the case file and on the wire.
REDUCTIONS: dict[str, Reduction] = {
    "greedy": _repeatable(greedy.reduce),
    "one-point": _repeatable(one_point.reduce),
    "greedy-combined": _repeatable(greedy_combined.reduce),
    "error-peaks": _repeatable(error_peaks.reduce),
    "incremental-lu": _repeatable(incremental_lu.reduce),
    "recurrence-cholesky": _repeatable(recurrence_cholesky.reduce),
    "grouped-circular": _repeatable(grouped_circular.reduce),
    "multilevel-subspace": _repeatable(multilevel_subspace.reduce),
    "multi-step": _repeatable(multi_step.reduce),
    "multiscale": _repeatable(multiscale.reduce),
    "grid-clustering": _repeatable(grid_clustering.reduce),
}
