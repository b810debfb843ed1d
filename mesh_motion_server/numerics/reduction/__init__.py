"""Point reduction: the displacement of a boundary from few of its nodes (thesis §2.2).

One algorithm a module, all called ``reduce(problem) -> Reduced``; :data:`REDUCTIONS` chooses by name. What an
algorithm leaves at the boundary nodes is in ``Reduced.error``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.blas import one_blas_thread
from mesh_motion_server.numerics.reduction import greedy
from mesh_motion_server.numerics.reduction.problem import Iterate, Level, Reduced, ReductionProblem

__all__ = ["REDUCTIONS", "Iterate", "Level", "Reduced", "Reduction", "ReductionProblem", "reduction_named"]


@dataclass(frozen=True)
class Reduction:
    """One algorithm.

    Attributes
    ----------
    name : str
        As in the case file and on the wire.
    reduce : callable
    source : str
        Where it is from, with the thesis' place.
    summary : str
        One line.
    """

    name: str
    reduce: Callable[[ReductionProblem], Reduced]
    source: str
    summary: str

    def __call__(self, problem: ReductionProblem) -> Reduced:
        """Run it; bitwise the same for any number of threads."""
        with one_blas_thread():
            return self.reduce(problem)


REDUCTIONS: dict[str, Reduction] = {
    row.name: row
    for row in (
        Reduction(
            "greedy",
            greedy.reduce,
            "Rendall & Allen 2009; thesis §2.2.2",
            "the node of the largest error, with a full solution for each",
        ),
    )
}


def reduction_named(name: str) -> Reduction:
    """Look an algorithm up.

    Raises
    ------
    InvalidInput
        If there is none of that name.
    """
    if name not in REDUCTIONS:
        raise InvalidInput(f"unknown reduction {name!r}", hint=f"known are {', '.join(REDUCTIONS)}")
    return REDUCTIONS[name]
