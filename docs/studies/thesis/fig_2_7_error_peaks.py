"""Fig 2.7: points chosen at the peaks of the error above a threshold."""

from __future__ import annotations

from typing import Any

import numpy as np
from mesh_motion_numerics.blas import one_blas_thread
from mesh_motion_numerics.reduction import Reduced, ReductionProblem
from mesh_motion_numerics.reduction.growing_set import full_weights
from mesh_motion_numerics.reduction.problem import lengths

from docs.studies.study import Cell, Outcome, Picture, Study, Table
from docs.studies.thesis._boundary_motions import MeshMotion, layered, wing
from docs.studies.thesis._point_reduction import error_peaks
from docs.studies.thesis._point_reduction.peaks import error_peaks as peaks_of
from docs.studies.thesis._point_reduction.peaks import nearest_neighbours

SHARES = (1.0, 0.9, 0.7, 0.5, 0.3, 0.1, 0.0)


def _row(problem: ReductionProblem, share: float) -> list[Cell]:
    """Points, iterations and cost with the peaks above a share of the largest error."""
    with one_blas_thread():
        found = error_peaks.reduce(problem, share=share)
    last, iterations = found.history[-1], len(found.history)
    added = (len(found.selected) - 1) / (iterations - 1)
    return [share, len(found.selected), iterations, added, last.solve_operations, last.error_operations]


def _table(case: MeshMotion, shares: tuple[float, ...]) -> Table:
    problem = case.problem(1e-3)
    columns = ("share", "points", "iterations", "L: points an iteration", "multiply-adds for weights", "φ for errors")
    caption = (
        f"**{case.title}**, {problem.n_points} boundary nodes, tolerance 1e−3. A share of 1 is the greedy algorithm."
    )
    return Table(columns, [_row(problem, share) for share in shares], caption, digits=3)


def run(quick: bool) -> Outcome:
    """Shares from 1 (the largest error only) to 0 (every peak)."""
    shares = (1.0, 0.5, 0.0) if quick else SHARES
    tables = [_table(case, shares) for case in (wing(), layered())]
    chosen = {row[0]: row for row in tables[0].rows}
    text = (
        f"On the wing a share of {error_peaks.PEAK_SHARE:g}, which is what `error-peaks` takes, needs "
        f"{chosen[0.5][1]} points instead of {chosen[1.0][1]}, in {chosen[0.5][2]} iterations instead of "
        f"{chosen[1.0][2]}, and {chosen[1.0][4] / chosen[0.5][4]:.0f} times fewer multiply-adds for weights."
    )
    pictures = [Picture(_draw, "The next points, with the threshold at half of the largest error.", (10.5, 3.6))]
    return Outcome(tables, pictures, text)


def _state(case: MeshMotion, points: int) -> tuple[ReductionProblem, Reduced, Any, Any]:
    """State after some iterations: problem, reduction, error lengths (nb,), and peaks above the threshold."""
    problem = case.problem(0.0)
    problem = ReductionProblem(
        problem.points, problem.displacement, support_radius=case.support_radius, tolerance=0.0, max_points=points
    )
    found = error_peaks.reduce(problem)
    weights = full_weights(problem, found.selected)
    size = lengths(problem.displacement - problem.values(problem.level(found.selected, weights))) / problem.largest
    peaks = peaks_of(size, nearest_neighbours(problem.points))
    return problem, found, size, peaks[size[peaks] >= error_peaks.PEAK_SHARE * size.max()]


def _draw(figure: Any) -> None:
    """The error along the ellipse, and on the wing seen from above."""
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.15))
    problem, found, size, peaks = _state(layered(), 9)
    body = np.flatnonzero(np.abs(problem.points).max(axis=1) < 0.11)
    angle = np.rad2deg(np.arctan2(problem.points[:, 1] / 0.02, problem.points[:, 0] / 0.1)) % 360
    order = body[np.argsort(angle[body])]
    left.plot(angle[order], size[order], lw=1.2, color="0.3", label="error")
    old, new = np.intersect1d(found.selected, body), np.intersect1d(peaks, body)
    left.plot(angle[old], size[old], "o", ms=5, mfc="w", color="C0", label="chosen before")
    left.plot(angle[new], size[new], "v", ms=8, color="C3", label="chosen next")
    left.axhline(0.5 * size.max(), color="C3", lw=0.8, ls="--", label="threshold")
    left.set(xlabel="angle around the ellipse, degrees", ylabel="error / largest displacement", xlim=(0, 360))
    left.set_title("ellipse that bends", fontsize=10)
    left.legend(fontsize=8)
    case = wing()
    problem, found, size, peaks = _state(case, 40)
    near = (
        (problem.points[:, 2] < 0.9) & (np.abs(problem.points[:, 0] - 0.6) < 0.8) & (np.abs(problem.points[:, 1]) < 0.4)
    )
    moving = np.linalg.norm(problem.displacement, axis=1) > 0.0
    at = problem.points[:, [0, 2]].T
    drawn = right.scatter(*at[:, moving], c=size[moving], s=9, cmap="viridis", linewidths=0)
    figure.colorbar(drawn, ax=right, label="error / largest displacement", shrink=0.8)
    right.plot(*at[:, peaks[near[peaks]]], "v", ms=7, color="C3", label="chosen next, its wall included")
    right.set(xlabel="x", ylabel="span z", aspect="equal")
    right.set_title("wing from above, 40 points chosen", fontsize=10)
    right.legend(fontsize=8, loc="upper left")


def claims(outcome: Outcome) -> None:
    """Check that a lower threshold needs fewer iterations and slightly more points."""
    for table in outcome.tables:
        iterations, points, work = (
            table.column(name) for name in (table.columns[2], table.columns[1], table.columns[4])
        )
        assert iterations == sorted(iterations, reverse=True)
        assert points[0] <= min(points) * 1.05
        half = table.column("share").index(0.5)
        assert points[half] < 1.25 * points[0]
        assert work[half] < 0.5 * work[0]


STUDY = Study(
    title="How many points may be added at a time?",
    source="Fig 2.7 (§2.2.3, (2.11), (2.12))",
    run=run,
    claims=claims,
    functions=(
        "docs.studies.thesis._point_reduction.error_peaks.reduce",
        "docs.studies.thesis._point_reduction.peaks.error_peaks",
    ),
)
