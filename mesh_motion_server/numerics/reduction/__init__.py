"""Point reduction: the displacement of a boundary from few of its nodes (thesis §2.2).

One algorithm per module, all called ``reduce(problem) -> Reduced``; :data:`REDUCTIONS` chooses by name. The error that
remains at the boundary nodes is in ``Reduced.error``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.blas import one_blas_thread
from mesh_motion_server.numerics.reduction import (
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
from mesh_motion_server.numerics.reduction.problem import Iterate, Level, Reduced, ReductionProblem

__all__ = ["REDUCTIONS", "Iterate", "Level", "Reduced", "Reduction", "ReductionProblem", "reduction_named"]


@dataclass(frozen=True)
class Reduction:
    """One algorithm.

    Attributes
    ----------
    name : str
        As in the case file and on the wire.
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
        Reduction(
            "one-point",
            one_point.reduce,
            "Rendall & Allen 2010; thesis (2.8)–(2.10)",
            "a correction of one coefficient for each point, full solutions at 16, 32, 64 … points",
        ),
        Reduction(
            "greedy-combined",
            greedy_combined.reduce,
            "Rendall & Allen 2010; thesis §2.2.2, Fig 2.6",
            "one-point corrections, and a full solution after every ten points",
        ),
        Reduction(
            "error-peaks",
            error_peaks.reduce,
            "Li et al.; thesis §2.2.3, Fig 2.7",
            "all peaks of the error above half of the largest, then a full solution",
        ),
        Reduction(
            "incremental-lu",
            incremental_lu.reduce,
            "Selim & Koomullil; thesis §2.2.3",
            "the greedy choice, with an LU factorization that is bordered for each point",
        ),
        Reduction(
            "recurrence-cholesky",
            recurrence_cholesky.reduce,
            "Fang et al.; thesis §2.2.3",
            "the greedy choice, with a Cholesky factor and the errors grown by a row and a column",
        ),
        Reduction(
            "grouped-circular",
            grouped_circular.reduce,
            "Fang et al. 2021; thesis §2.2.3, Fig 2.8",
            "the node of the largest error of one group of nodes after the other",
        ),
        Reduction(
            "multilevel-subspace",
            multilevel_subspace.reduce,
            "Wang et al. 2015, 2018; thesis §2.2.1, Table 2.3",
            "levels of few nodes, each greedy on what the levels before it left",
        ),
        Reduction(
            "multi-step",
            multi_step.reduce,
            "Floater & Iske 1996; thesis §2.2.1, Fig 2.4",
            "nested subsets from coarse to fine, each with half the support radius of the one before",
        ),
        Reduction(
            "multiscale",
            multiscale.reduce,
            "Kedward et al. 2017; thesis §2.2.1, Fig 2.5",
            "a base set, then every other node with a support radius as small as its separation: exact",
        ),
        Reduction(
            "grid-clustering",
            grid_clustering.reduce,
            "Strofylas et al. 2017; thesis §2.2.3",
            "a node for each cell of a grid, finer where the error is large",
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
