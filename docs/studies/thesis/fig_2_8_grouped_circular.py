"""Fig 2.8: the conventional greedy algorithm against the grouping-circular-based one."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from mesh_motion_numerics.blas import one_blas_thread
from mesh_motion_numerics.reduction import Reduced, ReductionProblem, grouped_circular

from docs.studies.study import Outcome, Picture, Study, Table
from docs.studies.thesis._boundary_motions import surface_problem
from docs.studies.thesis._point_reduction import greedy, recurrence_cholesky

#: m of the grouped algorithm.
GROUPS = (8, 32, 128)
CONVENTIONAL, CHOLESKY = "greedy, a solution for each point", "greedy, growing Cholesky factor"
LADDER = 400


@dataclass(frozen=True)
class Point:
    """A run with a given number of points: error at all nodes and cost."""

    points: int
    error: float
    seconds: float
    error_operations: float
    operations: float


def _ran(reduce: Callable[[ReductionProblem], Reduced], problem: ReductionProblem) -> Point:
    """A timed run."""
    began = time.process_time()
    with one_blas_thread():
        found = reduce(problem)
    seconds = time.process_time() - began
    last = found.history[-1]
    total = last.solve_operations + last.error_operations
    return Point(len(found.selected), found.max_error / problem.largest, seconds, last.error_operations, total)


def _algorithms() -> dict[str, Callable[[ReductionProblem], Reduced]]:
    grouped = {f"grouped, m = {m}": partial(grouped_circular.reduce, groups=m) for m in GROUPS}
    return {CONVENTIONAL: greedy.reduce, CHOLESKY: recurrence_cholesky.reduce, **grouped}


def run(quick: bool) -> Outcome:
    """Both algorithms to the same numbers of points, and to the same tolerance."""
    problem = surface_problem(0.02 if quick else 0.0068)
    ladder = [12, 25, 50] if quick else [12, 25, 50, 100, 200, LADDER]
    for reduce in _algorithms().values():
        _ran(reduce, replace(problem, max_points=10))  # in the caches before anything is timed
    curves = {
        name: [_ran(reduce, replace(problem, tolerance=0.0, max_points=n)) for n in ladder]
        for name, reduce in _algorithms().items()
    }
    to_tolerance = {name: _ran(reduce, problem) for name, reduce in _algorithms().items()}
    base = curves[CONVENTIONAL][-1]
    rows = []
    for name, found in curves.items():
        last, enough = found[-1], to_tolerance[name]
        shares = [base.error_operations / last.error_operations, base.operations / last.operations]
        rows.append([name, last.error, *shares, base.seconds / last.seconds, enough.points, enough.error])
    columns = (
        "algorithm",
        f"error at {ladder[-1]} points",
        "φ for errors: fewer by",
        "operations: fewer by",
        "CPU time: less by",
        "points to 1e−3",
        "error there",
    )
    caption = f"{problem.n_points} boundary nodes. Factors are against the first row, errors relative to the motion."
    return Outcome([Table(columns, rows, caption, digits=3)], [_picture(curves)], _words(rows, ladder[-1]))


def _words(rows: list[list[Any]], points: int) -> str:
    """The values of the table."""
    conventional, _, *grouped = rows
    best = max(grouped, key=lambda row: float(row[4]))
    worst_ratio = max(row[1] / conventional[1] for row in grouped)
    return (
        f"To {points} points the grouped algorithm is up to {best[4]:.0f} times as fast ({best[0]}), the error it "
        f"leaves at all nodes at most {worst_ratio:.2f} times that of the conventional choice; to the tolerance it "
        f"takes {min(row[5] for row in grouped)} to {max(row[5] for row in grouped)} points for {conventional[5]}."
    )


def _picture(curves: dict[str, list[Point]]) -> Picture:
    def draw(figure: Any) -> None:
        axes = figure.subplots(1, 3, sharey=True)
        views = (("points", "points"), ("seconds", "CPU time, s"), ("operations", "operations"))
        for ax, (field, label) in zip(axes, views, strict=True):
            for (name, found), style in zip(curves.items(), ("ko-", "C7s--", "C0.-", "C1.-", "C2.-"), strict=True):
                ax.loglog([getattr(p, field) for p in found], [p.error for p in found], style, label=name)
            ax.set(xlabel=label)
            ax.grid(alpha=0.3)
        ladder = [p.points for p in curves[CONVENTIONAL]]
        axes[0].set_xticks(ladder, labels=[str(n) for n in ladder])
        axes[0].minorticks_off()
        axes[0].set(ylabel="largest error / largest displacement")
        axes[0].legend(fontsize=7)

    caption = "Largest error at all boundary nodes against the number of points, CPU time and counted operations."
    return Picture(draw, caption, (11.0, 3.8))


def claims(outcome: Outcome) -> None:
    """Check that the error is close to the conventional algorithm's, with a share of its operations given by m."""
    rows = {row[0]: row for row in outcome.tables[0].rows}
    conventional = rows[CONVENTIONAL]
    for m in GROUPS:
        grouped = rows[f"grouped, m = {m}"]
        if m < 128:
            assert float(grouped[1]) < 2.0 * float(conventional[1])
            assert float(grouped[2]) > 0.4 * m
            assert int(grouped[5]) < 1.3 * int(conventional[5])
        assert float(grouped[3]) > 2.0
        assert float(grouped[6]) <= 1.001e-3


STUDY = Study(
    title="What does the search in one group of nodes at a time save, and what does it cost in accuracy?",
    source="Fig 2.8",
    run=run,
    claims=claims,
    functions=(
        "mesh_motion_numerics.reduction.grouped_circular.reduce",
        "docs.studies.thesis._point_reduction.greedy.reduce",
        "mesh_motion_numerics.reduction.growing_set.GrowingSet",
    ),
)
