"""Tables 5.4 to 5.7 and Figs 5.9 to 5.18: the method of explicit iterations on the thesis' three motions."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from mesh_motion_numerics.correction.enrichment.explicit_iterations import (
    ExplicitResult,
    ExplicitSettings,
)
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import factorize
from numpy.typing import NDArray

from docs.studies.study import Cell, Outcome, Picture, Study, Table
from docs.studies.thesis._block import BlockCase, block_case, draw_mesh, turned
from docs.studies.thesis._cell_corrections import CELL_CORRECTIONS
from docs.studies.thesis._field_iterations import predicted_iterations

Floats = NDArray[np.float64]

#: As the thesis does it; its relaxation is not printed.
THESIS = ExplicitSettings(enrichment_radius=0.5, threshold=0.2, metric="size", relaxation=1.3)

#: Case → threshold, printed minimum of the standard motion, after the iterations, and their number.
PRINTED = {
    "x": (0.19, -0.25, 0.19, 7),
    "x and y": (0.2, -0.53, 0.2, 14),
    "rotation": (0.27, -0.57, 0.27, 13),
}
DECOMPOSITIONS = ("eigen", "polar", "svd", "qr")


def explicit(case: BlockCase, settings: ExplicitSettings, predictor: str = "centre-gradient") -> ExplicitResult:
    """Run the iterations, by default with the thesis' predictor."""
    return predicted_iterations(case.problem, settings, case.field, predictor)


def run(quick: bool) -> Outcome:
    found = {name: explicit(block_case(name), replace(THESIS, threshold=row[0])) for name, row in PRINTED.items()}
    main: list[list[Cell]] = []
    for name, (threshold, standard, reached, iterations) in PRINTED.items():
        case, result = block_case(name), found[name]
        last = result.history[result.best]
        row: list[Cell] = [name, standard, case.smallest(case.problem.standard), threshold, iterations, result.best]
        main.append([*row, reached, last.predicted, last.actual])
    columns = ["motion", "standard, thesis", "standard", "threshold", "iterations, thesis", "iterations"]
    columns += ["reached, thesis", "predicted", "actual"]
    caption = "Minimum size; R = R_l = 0.5, relaxation 1.3, prediction at the centres. Iterations to the threshold."
    tables = (
        Table(columns, main, caption, digits=3),
        _steps(quick),
        _variants(quick),
        _decompositions(),
    )
    pictures = (
        Picture(
            _convergence,
            "Figs 5.10e, 5.12a, 5.15, 5.18a: minimum size, 20 iterations.",
            (9.5, 3),
        ),
        Picture(
            lambda figure: _meshes(figure, found),
            "Figs 5.10, 5.11, 5.14: standard above, explicit below; size from 0 (dark) to 1; inverted cells red.",
            (8.2, 6.2),
        ),
        Picture(
            lambda figure: _places(figure, found),
            "Figs 5.10f, 5.12b, 5.16: enrichment points in their order, near ones together.",
            (9, 3),
        ),
        Picture(lambda figure: _action(figure, found), "Figs 5.11e–f, 5.17: what the enrichment adds.", (9.5, 4.4)),
    )
    return Outcome(tables, pictures)


def _steps(quick: bool) -> Table:
    """Table 5.7: the rotation in one step and in twenty, with both radii, against the iterations."""
    wide = block_case("rotation", 2.5)
    iterated = explicit(wide, replace(THESIS, threshold=0.27))
    rows: list[list[Cell]] = [
        ["standard, 1 step", 0.5, -0.57, wide_minimum(0.5), 0],
        ["standard, 1 step", 2.5, -0.57, wide_minimum(2.5), 0],
        ["standard, 20 steps", 2.5, 0.27, None if quick else relative_steps(2.5, 20), 0],
        ["explicit, predicted", 2.5, 0.27, iterated.history[iterated.best].predicted, iterated.best],
        ["explicit, actual", 2.5, None, iterated.history[iterated.best].actual, iterated.best],
    ]
    columns = ("motion", "R", "thesis", "minimum size", "iterations")
    return Table(columns, rows, "Table 5.7: the rotation; the thesis needs 12 iterations with R = 2.5.", digits=3)


def wide_minimum(radius: float) -> float:
    """Minimum size of the rotation in one standard step."""
    case = block_case("rotation", radius)
    return case.smallest(case.problem.standard)


def relative_steps(radius: float, count: int) -> float:
    """Minimum size of the rotation in ``count`` relative steps."""
    case = block_case("rotation", radius)
    points, held = case.problem.start, np.flatnonzero(case.problem.held)
    for step in range(1, count + 1):
        target = case.problem.start.copy()
        share = step / count
        target[case.body] = turned(case.problem.start[case.body], (-0.2 * share, -0.2 * share), 60.0 * share)
        interpolant = factorize(points[held], support_radius=radius).solve((target - points)[held])
        points = points + evaluation.displacement(interpolant, points)
        points[held] = target[held]
    return case.smallest(points)


def _variants(quick: bool) -> Table:
    """Iterations to the threshold by relaxation and predictor, which the thesis does not print."""
    rows: list[list[Cell]] = []
    for predictor in ("centre-gradient", "trial-nodes"):
        for relaxation in (1.3, 2.0) if quick else (1.0, 1.3, 1.6, 2.0):
            row: list[Cell] = [predictor, relaxation]
            for name, (threshold, *_) in PRINTED.items():
                settings = replace(THESIS, threshold=threshold, relaxation=relaxation)
                found = explicit(block_case(name), settings, predictor)
                row += [_count(found), found.history[found.best].actual]
            rows.append(row)
    columns = ["predictor", "relaxation"]
    for name in PRINTED:
        columns += [f"{name}: iterations", "actual"]
    return Table(columns, rows, "Results by relaxation and predictor; –: 20 iterations are not enough.", digits=3)


def _count(found: ExplicitResult) -> Cell:
    return found.best if found.reached else None


def _decompositions() -> Table:
    """Iterations to the threshold with each decomposition and the exact predictor."""
    rows: list[list[Cell]] = []
    for name in DECOMPOSITIONS:
        row: list[Cell] = [name]
        for case, (threshold, *_) in PRINTED.items():
            settings = replace(THESIS, threshold=threshold, correct_cell=CELL_CORRECTIONS[name])
            found = explicit(block_case(case), settings, "trial-nodes")
            row += [_count(found), found.history[found.best].actual]
        rows.append(row)
    columns = ["decomposition"]
    for case in PRINTED:
        columns += [f"{case}: iterations", "actual"]
    return Table(columns, rows, "Results by decomposition (exact prediction, relaxation 1.3).", digits=3)


def _convergence(figure: Any) -> None:
    for ax, name in zip(figure.subplots(1, 3), PRINTED, strict=True):
        history = explicit(block_case(name), replace(THESIS, threshold=0.9)).history
        ax.plot([h.predicted for h in history], ".-", label="predicted")
        ax.plot([h.actual for h in history], ".--", label="actual")
        ax.plot([0, PRINTED[name][3]], PRINTED[name][1:3], "k*", label="thesis")
        ax.axhline(0, color="k", lw=0.5)
        ax.set(title=name, xlabel="iterations", ylim=(-0.75, 0.45))
        ax.legend(fontsize=7, loc="lower right")


def _meshes(figure: Any, found: dict[str, ExplicitResult]) -> None:
    axes = figure.subplots(2, 3)
    for column, name in enumerate(PRINTED):
        case = block_case(name)
        draw_mesh(axes[0, column], case, case.problem.standard, f"{name}: standard")
        draw_mesh(axes[1, column], case, found[name].points, f"explicit, {found[name].best} iterations")


def _places(figure: Any, found: dict[str, ExplicitResult]) -> None:
    for ax, name in zip(figure.subplots(1, 3), PRINTED, strict=True):
        case = block_case(name)
        x = case.problem.start
        ax.triplot(*x.T, case.triangles, color="0.5", lw=0.2, alpha=0.5, antialiased=False)
        low, high = found[name].enrichment_points.min(axis=0), found[name].enrichment_points.max(axis=0)
        middle, half = 0.5 * (low + high), 0.5 * float((high - low).max()) + 0.05
        for place, numbers in _by_place(found[name].enrichment_points, 0.18 * half).items():
            ax.plot(*place, "r.", ms=3)
            ax.annotate(", ".join(map(str, numbers)), place, (0, 3), "data", "offset points", **_NUMBER)
        ax.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half))
        ax.set_aspect("equal")
        ax.tick_params(labelsize=7)
        ax.set_title(name, fontsize=9)


_NUMBER = {"color": "r", "fontsize": 7, "ha": "center"}


def _by_place(points: Floats, near: float) -> dict[tuple[float, ...], list[int]]:
    """Labels of the points; points near each other share one label, so that labels do not overlap."""
    found: dict[tuple[float, ...], list[int]] = {}
    for number, point in enumerate(points, start=1):
        close = [place for place in found if np.linalg.norm(point - place) < near]
        found.setdefault(close[0] if close else tuple(point.tolist()), []).append(number)
    return found


def _action(figure: Any, found: dict[str, ExplicitResult]) -> None:
    axes = figure.subplots(2, 3)
    for column, name in enumerate(PRINTED):
        case = block_case(name)
        added = found[name].points - case.problem.standard
        limit = float(np.abs(added).max())
        for row, component in enumerate("xy"):
            ax = axes[row, column]
            levels = np.linspace(-limit, limit, 13)
            shown = ax.tricontourf(*case.problem.start.T, case.triangles, added[:, row], levels, cmap="coolwarm")
            ax.set_aspect("equal")
            ax.set_axis_off()
            ax.set_title(f"{name}: displacement in {component}", fontsize=9)
        figure.colorbar(shown, ax=axes[:, column], shrink=0.7, ticks=[-limit, 0, limit], format="%.2f")


def claims(outcome: Outcome) -> None:
    main, steps, variants, decompositions = outcome.tables
    for row in main.rows:
        assert abs(float(row[2]) - float(row[1])) < 0.1
        assert float(row[7]) >= float(row[3])
        assert abs(int(row[5]) - int(row[4])) <= 4
        assert float(row[8]) < float(row[7])  # the prediction at the centres is too good
    assert all(iterations is not None for iterations in variants.rows[1][2::2])
    assert abs(float(steps.rows[0][3]) + 0.57) < 0.1
    names = decompositions.column("decomposition")
    polar, triangles = decompositions.rows[names.index("polar")], decompositions.rows[names.index("qr")]
    assert min(float(value) for value in polar[2::2]) > 0.1 > min(float(value) for value in triangles[2::2])


STUDY = Study(
    "How many explicit iterations reach a threshold, and does the mesh have the predicted quality?",
    "Tables 5.4–5.7, Figs 5.9–5.18 (Algorithm 1, equations 5.14–5.17)",
    run,
    claims,
    (
        "mesh_motion_numerics.correction.enrichment.explicit_iterations.explicit_iterations",
        "mesh_motion_numerics.correction.enrichment.eigen_correction.eigen_correction",
        "docs.studies.thesis._cell_corrections.CELL_CORRECTIONS",
    ),
)
