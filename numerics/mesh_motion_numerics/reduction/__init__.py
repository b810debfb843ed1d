"""Point reduction: the displacement of a boundary from few of its nodes (thesis §2.2).

:data:`REDUCTIONS` has the algorithms by name. The error that remains at the boundary nodes is in ``Reduced.error``. The
other algorithms that the thesis reviews are compared with these in docs/studies/thesis.
"""

from collections.abc import Callable
from functools import wraps

from mesh_motion_numerics.blas import one_blas_thread
from mesh_motion_numerics.reduction import grouped_circular
from mesh_motion_numerics.reduction.problem import Iterate, Level, Reduced, ReductionProblem

__all__ = ["REDUCTIONS", "Iterate", "Level", "Reduced", "ReductionProblem", "repeatable"]

Reduction = Callable[[ReductionProblem], Reduced]


def repeatable(reduce: Reduction) -> Reduction:
    """Make the algorithm bitwise repeatable for any number of threads."""

    @wraps(reduce)
    def run(problem: ReductionProblem) -> Reduced:
        with one_blas_thread():
            return reduce(problem)

    return run


#: Every algorithm by its name in the case file and on the wire.
REDUCTIONS: dict[str, Reduction] = {
    "greedy": repeatable(grouped_circular.greedy),
    "grouped-circular": repeatable(grouped_circular.reduce),
}
