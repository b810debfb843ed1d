"""Table 2.3: how the cost of choosing points grows with their number."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from mesh_motion_numerics.reduction import Reduced, ReductionProblem

from docs.studies.study import Cell, Outcome, Picture, Study, Table
from docs.studies.thesis._boundary_motions import surface_problem
from docs.studies.thesis._point_reduction import REDUCTIONS
from docs.studies.thesis._point_reduction.greedy_combined import FULL_EVERY
from docs.studies.thesis._point_reduction.multilevel_subspace import POINTS_PER_LEVEL


@dataclass(frozen=True)
class Printed:
    """The thesis' formula for an algorithm; its leading term is ``N^power / divisor``.

    A divisor of None means four times the measured L, points per iteration.
    """

    name: str
    formula: str
    power: int
    divisor: float | None

    def leading(self, n: int, iterations: int) -> float:
        """The term at ``n`` points chosen in the given number of iterations."""
        return float(n) ** self.power / (self.divisor or 4.0 * n / iterations)


PRINTED = (
    Printed("greedy", "N⁴/4", 4, 4.0),
    Printed("greedy-combined", "– (N⁴/40)", 4, 4.0 * FULL_EVERY),
    Printed("error-peaks", "N⁴/(4L)", 4, None),
    Printed("multilevel-subspace", "N⁴/(4M)", 4, 4.0 * POINTS_PER_LEVEL),
    Printed("incremental-lu", "N³", 3, 1.0),
    Printed("recurrence-cholesky", "N³/2", 3, 2.0),
)


def _bounded(problem: ReductionProblem, points: int) -> ReductionProblem:
    return ReductionProblem(
        problem.points,
        problem.displacement,
        support_radius=problem.support_radius,
        tolerance=0.0,
        max_points=points,
    )


def _run(problem: ReductionProblem, name: str, points: int) -> tuple[Reduced, float]:
    """A reduction to a given number of points, and its CPU seconds."""
    began = time.process_time()
    found = REDUCTIONS[name](_bounded(problem, points))
    return found, time.process_time() - began


def _row(problem: ReductionProblem, printed: Printed, points: int) -> list[Cell]:
    """Exponent of the growth from half of the points to all of them."""
    half, half_seconds = _run(problem, printed.name, points // 2)
    full, seconds = _run(problem, printed.name, points)
    n = len(full.selected)
    doubled = math.log(n / len(half.selected))
    solve = full.history[-1].solve_operations
    return [
        printed.name,
        printed.formula,
        n,
        math.log(solve / half.history[-1].solve_operations) / doubled,
        solve,
        solve / printed.leading(n, len(full.history)),
        full.history[-1].error_operations / (float(n) ** 2 * problem.n_points),
        math.log(seconds / half_seconds) / doubled,
        seconds,
    ]


def run(quick: bool) -> Outcome:
    """Compare the costs on few nodes: there the weights, which the table shows, cost more than the errors."""
    problem, points = (surface_problem(0.03), 160) if quick else (surface_problem(0.02), 1000)
    REDUCTIONS["greedy"](_bounded(problem, 4))  # code is loaded once
    rows = [_row(problem, printed, points) for printed in PRINTED]
    columns = (
        "algorithm",
        "printed",
        "N",
        "exponent of the multiply-adds",
        "multiply-adds for weights",
        "of the printed term",
        "φ for errors / N² N_b",
        "exponent of CPU time",
        "CPU s",
    )
    step = next(row for row in rows if row[0] == "error-peaks")
    greedy = rows[0]
    text = (
        f"{problem.n_points} boundary nodes; exponents from N/2 to N. L = {_mean_step(problem, points):.0f} peaks an "
        f"iteration, M = {POINTS_PER_LEVEL}. The full algorithm takes {greedy[8]:.2g} s, error peaks {step[8]:.2g} s."
    )
    return Outcome(
        [Table(columns, rows, digits=3)],
        [Picture(_drawing(problem, points), "Multiply-adds for weights.", (8.0, 3.8))],
        text,
    )


def _mean_step(problem: ReductionProblem, points: int) -> float:
    """L: points per iteration of the error peaks."""
    found, _ = _run(problem, "error-peaks", points)
    return len(found.selected) / len(found.history)


def _drawing(problem: ReductionProblem, points: int) -> Callable[[Any], None]:
    """Multiply-adds against points."""
    histories = {p.name: _run(problem, p.name, points)[0].history for p in PRINTED}

    def draw(figure: Any) -> None:
        axis = figure.subplots()
        for name, history in histories.items():
            n, work = (np.array([getattr(i, key) for i in history]) for key in ("points", "solve_operations"))
            axis.loglog(n[n > 8], work[n > 8], lw=1.3, label=name)
        n = np.array([60.0, points])
        axis.loglog(n, n**4 / 24, "k--", lw=0.8, label="N⁴/24")
        axis.loglog(n, n**3 / 6, "k:", lw=0.8, label="N³/6")
        axis.set(xlabel="points N", ylabel="multiply-adds for weights")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))

    return draw


def claims(outcome: Outcome) -> None:
    """Check fourth powers with full solutions, third powers with growing factors, and the reduction by L."""
    rows = {row[0]: row for row in outcome.tables[0].rows}
    exponent = {name: float(row[3]) for name, row in rows.items()}
    for name in ("greedy", "greedy-combined", "error-peaks"):
        assert 3.2 < exponent[name] < 4.1
    for name in ("incremental-lu", "recurrence-cholesky"):
        assert 2.7 < exponent[name] < 3.1
    assert rows["greedy"][4] > 3 * rows["error-peaks"][4]
    assert rows["incremental-lu"][4] > 1.9 * rows["recurrence-cholesky"][4]
    assert 0.15 < rows["greedy"][5] < 0.35
    assert abs(rows["greedy"][6] - 0.5) < 0.02


STUDY = Study(
    title="What does the choice of N points cost?",
    source="Table 2.3, and the N_c³ of incremental LU and recurrence Cholesky (§2.2.3)",
    run=run,
    claims=claims,
    functions=(
        "mesh_motion_numerics.reduction.growing_set.full_operations",
        "docs.studies.thesis._point_reduction.incremental_lu.GrowingLU",
        "docs.studies.thesis._point_reduction.recurrence_cholesky.reduce",
    ),
)
