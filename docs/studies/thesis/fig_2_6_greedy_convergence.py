"""Fig 2.6: the error of the three greedy algorithms against the number of points."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from mesh_motion_numerics.blas import one_blas_thread
from mesh_motion_numerics.reduction import Iterate, Reduced, ReductionProblem
from mesh_motion_numerics.reduction.growing_set import full_weights

from docs.studies.study import Cell, Outcome, Picture, Study, Table
from docs.studies.thesis._boundary_motions import MeshMotion, block, wing
from docs.studies.thesis._point_reduction import greedy, greedy_combined
from docs.studies.thesis._point_reduction.one_point import corrected_reduction

FULL, ONE, COMBINED = "full point", "one point", "one point, a full solution every 10"
#: The thesis' algorithms; "one point" without the full solutions that this implementation checks it with.
ALGORITHMS: dict[str, Callable[[ReductionProblem], Reduced]] = {
    FULL: greedy.reduce,
    ONE: lambda problem: corrected_reduction(problem, lambda points: points < 0),  # never
    COMBINED: greedy_combined.reduce,
}


def _cases(quick: bool) -> list[tuple[MeshMotion, int]]:
    """A surface in 3D and a curve in 2D, and the maximum number of points."""
    return [(wing(1.0), 80 if quick else 400), (block(), 40)]


def _latest(history: tuple[Iterate, ...], points: int) -> Iterate:
    """The last state of an algorithm with the given number of points."""
    return [iterate for iterate in history if iterate.points == points][-1]


def _before_the_end(history: tuple[Iterate, ...]) -> tuple[Iterate, ...]:
    """The history without the final full solution, which is not a step of the algorithm."""
    return history[:-1] if history[-1].points == history[-2].points else history


def _solved_again(problem: ReductionProblem, found: Reduced, points: int) -> float:
    """Largest error of a full solution on the first points of a choice."""
    selected = found.selected[:points]
    left = problem.displacement - problem.values(problem.level(selected, full_weights(problem, selected)))
    return float(np.linalg.norm(left, axis=1).max()) / problem.largest


def _compared(case: MeshMotion, most: int) -> tuple[Table, dict[str, Reduced]]:
    """Errors at a quarter, half and all of the points, and the cost."""
    problem = case.problem(0.0)
    problem = ReductionProblem(
        problem.points, problem.displacement, support_radius=case.support_radius, tolerance=0.0, max_points=most
    )
    marks, found, rows = (most // 4, most // 2, most), {}, []
    for name, reduce in ALGORITHMS.items():
        with one_blas_thread():
            began = time.process_time()
            found[name] = reduce(problem)
            seconds = time.process_time() - began
        history = _before_the_end(found[name].history)
        errors: list[Cell] = [_latest(history, n).max_error / problem.largest for n in marks]
        again = _solved_again(problem, found[name], most)
        rows.append([name, *errors, again, history[-1].solve_operations, history[-1].error_operations, 1000 * seconds])
    columns = ["algorithm", *(f"error at {n}" for n in marks), f"solved again at {most}"]
    columns += ["multiply-adds for weights", "φ for errors", "CPU ms"]
    caption = (
        f"**{case.title}**, {problem.n_points} boundary nodes; largest error as a share of the largest displacement."
    )
    return Table(columns, rows, caption, digits=3), found


def run(quick: bool) -> Outcome:
    """Both boundaries, with the errors that the algorithms estimate."""
    compared = [(case, *_compared(case, most)) for case, most in _cases(quick)]
    curves = [(case.title, found, case.problem(0.0).largest) for case, _, found in compared]

    def draw(figure: Any) -> None:
        for axis, (title, found, largest) in zip(figure.subplots(1, len(curves)), curves, strict=True):
            for name, reduced in found.items():
                history = _before_the_end(reduced.history)
                axis.semilogy([i.points for i in history], [i.max_error / largest for i in history], label=name, lw=1.2)
            axis.set(title=title, xlabel="points", ylabel="largest error / largest displacement")
            axis.grid(alpha=0.3)
        axis.legend(fontsize=8)

    picture = Picture(draw, "Largest error at all boundary nodes, as each algorithm estimates it.", (10.0, 3.8))
    return Outcome([table for _, table, _ in compared], [picture], _words(compared[0][1]))


def _words(table: Table) -> str:
    """The values of the first table."""
    rows = {row[0]: dict(zip(table.columns, row, strict=True)) for row in table.rows}
    last, again = table.columns[3], table.columns[4]
    ratio = {name: rows[name][last] / rows[FULL][last] for name in rows}
    choice = rows[ONE][again] / rows[FULL][again]
    work = rows[COMBINED]["multiply-adds for weights"] / rows[FULL]["multiply-adds for weights"]
    return (
        f"On the wing the combined algorithm has {ratio[COMBINED]:.2g} times the full one's error, for {work:.1%} "
        f"of the multiply-adds; one-point corrections alone have {ratio[ONE]:.0f} times. A full solution on the "
        f"points of the one-point corrections still leaves {choice:.0f} times the full algorithm's error: poor "
        f"coefficients lead to a poor choice of points, and a full solution at the end cannot repair this."
    )


def claims(outcome: Outcome) -> None:
    """Check the order of Fig 2.6 (full, combined, one point), the poor choice of one point, and falling errors."""
    for table in outcome.tables:
        rows = {row[0]: row for row in table.rows}
        assert rows[FULL][3] < rows[COMBINED][3] < rows[ONE][3]
        assert rows[COMBINED][3] < 5 * rows[FULL][3]
        assert rows[ONE][4] > 5 * rows[FULL][4]
        assert rows[COMBINED][5] < 0.3 * rows[FULL][5]
        for row in (rows[FULL], rows[COMBINED]):
            assert row[1] > row[2] > row[3]


STUDY = Study(
    title="How much accuracy do one-point corrections cost?",
    source="Fig 2.6 (§2.2.2, (2.8)–(2.10))",
    run=run,
    claims=claims,
    functions=(
        "docs.studies.thesis._point_reduction.greedy.reduce",
        "docs.studies.thesis._point_reduction.one_point.reduce",
        "docs.studies.thesis._point_reduction.greedy_combined.reduce",
    ),
)
