"""Tables 5.2 to 5.4 and Figs 5.4 to 5.6: the best Jacobian at the worst cell in 2D, by trying all of a grid."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from mesh_motion_numerics.correction.enrichment.explicit_iterations import ExplicitSettings
from mesh_motion_numerics.correction.enrichment.imposed_jacobian import (
    ImposedSettings,
    cell_gradients,
    impose,
    imposed_jacobians,
)
from mesh_motion_numerics.correction.enrichment.placement import Placement
from mesh_motion_numerics.correction.enrichment.space import EnrichmentSpace
from mesh_motion_numerics.quality.metrics import cell_quality
from numpy.typing import NDArray

from docs.studies.study import Cell, Outcome, Picture, Study, Table
from docs.studies.thesis._block import BlockCase, block_case, draw_mesh
from docs.studies.thesis._cell_corrections import CELL_CORRECTIONS
from docs.studies.thesis._field_iterations import predicted_iterations
from docs.studies.thesis._predictors import predict

Floats = NDArray[np.float64]

RADII = (0.2, 0.4, 0.6, 0.8, 1.0)
PLACES_RADIUS = 0.8
#: Of the nodes, Table 5.1.
SPACING = 0.04


@dataclass(frozen=True, eq=False)
class Sweep:
    """One enrichment point whose Jacobian is varied: every cell's B is linear in it.

    Attributes
    ----------
    standard : (m, 2, 2) array
        B of the cells without enrichment; rows are components.
    response : (m, 2, 2) array
        ``[c, k, j]``: what the entry (i, k) of J − J_0 adds to ``B_c[i, j]``.
    predicted : (2, 2) array
        J_0: the standard motion's own Jacobian at the point.
    displacement : (n, 2) array
        ψ G⁻¹ at the nodes: the displacement is ``S + displacement (J − J_0)ᵀ``.
    """

    standard: Floats
    response: Floats
    predicted: Floats
    displacement: Floats


def sweep_at(case: BlockCase, point: Floats, radius: float) -> Sweep:
    """Thesis (5.6) with one enrichment point (2,), solved for all Jacobians at once."""
    p = case.problem
    placement = Placement(np.zeros(1, dtype=np.int64), point[None], np.array([radius]))
    space = EnrichmentSpace(placement, p.factorization, ("H1",))
    slopes = space.gradients(point[None])
    unit = np.stack([impose(slopes, np.outer([1.0, 0.0], e)[None])[:, 0] for e in np.eye(2)], axis=1)
    nodal = np.where(p.held[:, None], 0.0, space.values(p.start) @ unit)
    every = np.arange(len(p.cells))
    standard = np.eye(2) + cell_gradients(p.start, p.standard - p.start, p.cells, every)
    return Sweep(standard, cell_gradients(p.start, nodal, p.cells, every), case.field.gradient(point[None])[0], nodal)


def best_jacobian(sweep: Sweep, values: Floats, rounds: int = 0) -> tuple[float, Floats]:
    """Best minimum size and its J (2, 2), from a grid of entries and ``rounds`` finer grids around the best."""
    best, found = _tried(sweep, [values] * 4)
    step = float(values[1] - values[0])
    for _ in range(rounds):
        step /= 2
        around = [entry + step * np.array([-2.0, -1.0, 0.0, 1.0, 2.0]) for entry in found.ravel()]
        better, at = _tried(sweep, around)
        if better > best:
            best, found = better, at
    return best, found


def _tried(sweep: Sweep, entries: list[Floats]) -> tuple[float, Floats]:
    """Best minimum size over all J with the given entries, and the first such J.

    For each J an upper bound of its minimum is kept: the smallest size of the cells checked so far. The J with the
    highest bound is checked with all cells. If the bound is its minimum, no other J is better; else its worst cell is
    checked for every J.
    """
    first, second = (np.array(list(product(*pair))) for pair in (entries[:2], entries[2:]))
    bounds = np.ones((len(first), len(second)))
    while True:
        i, j = np.unravel_index(bounds.argmax(), bounds.shape)
        jacobian = np.stack([first[i], second[j]])
        sizes = _sizes(sweep, jacobian)
        worst = int(sizes.argmin())
        if sizes[worst] == bounds[i, j]:
            return float(sizes[worst]), jacobian
        np.minimum(bounds, _signed_sizes(sweep, first[:, None], second, worst), out=bounds)


def _sizes(sweep: Sweep, jacobian: Floats) -> Floats:
    """(m,) signed sizes with a Jacobian (2, 2) imposed."""
    return _signed_sizes(sweep, jacobian[0], jacobian[1], slice(None))


def _signed_sizes(sweep: Sweep, first: Floats, second: Floats, cells: int | slice) -> Floats:
    """Signed sizes of cells for imposed Jacobians with these first and second rows (..., 2)."""
    (x, y), (u, v) = (_row(sweep, i, row, cells) for i, row in enumerate((first, second)))
    tau = np.asarray(x * v - y * u)
    return np.divide(1.0, tau, out=tau, where=np.abs(tau) > 1.0)


def _row(sweep: Sweep, i: int, imposed: Floats, cells: int | slice) -> list[Floats]:
    """Both entries of row i of the cells' B."""
    a, b = np.moveaxis(imposed - sweep.predicted[i], -1, 0)
    standard, response = sweep.standard[cells, i], sweep.response[cells]
    return [standard[..., j] + a * response[..., 0, j] + b * response[..., 1, j] for j in range(2)]


def worst_point(case: BlockCase) -> Floats:
    """(2,) centre of the cell of the smallest predicted size."""
    p = case.problem
    quality = predict("centre-gradient", p.start, p.cells, p.reference_sizes, case.field).metric("size")
    return p.cells.centres(p.start, np.array([int(np.argmin(quality))]))[0]


def run(quick: bool) -> Outcome:
    case = block_case("x")
    point, values = worst_point(case), np.linspace(-3.0, 3.0, 11 if quick else 31)
    every = case.problem.cells.centres(case.problem.start, np.arange(len(case.problem.cells)))
    rows: list[list[Cell]] = []
    sweeps: list[Any] = []
    for radius in RADII:
        sweep = sweep_at(case, point, radius)
        best, found = best_jacobian(sweep, values)
        refined, exact = best_jacobian(sweep, values, 0 if quick else 4)
        worst = every[int(np.argmin(_sizes(sweep, found)))]
        entries = [float(found[0, 0]), float(found[1, 0]), float(found[0, 1]), float(found[1, 1])]
        rows.append([radius, *entries, best, refined, _pair(worst)])
        sweeps.append((radius, sweep, exact, refined))
    columns = ["R_l", "J11 = ∂S_x/∂x", "J12 = ∂S_y/∂x", "J21 = ∂S_x/∂y", "J22 = ∂S_y/∂y"]
    columns += ["minimum size", "refined", "place of the minimum"]
    caption = f"Table 5.3, Fig 5.6: best of {len(values)}⁴ Jacobians imposed at {_pair(point)}; R = 0.5, dx = −0.3."
    response = Table(columns, rows, caption, digits=3)
    best = max(sweeps, key=lambda s: s[3])
    places = _places(case, every, quick)
    pictures = (
        Picture(
            lambda figure: _meshes(figure, case, best),
            "Figs 5.4 and 5.5: without and with the best Jacobian; size from 0 (dark) to 1; inverted cells red.",
            (10, 3.6),
        ),
        Picture(lambda figure: _responses(figure, rows, sweeps, places), "Fig 5.6, and the best place.", (9.5, 3.2)),
    )
    return Outcome(
        (response, _compared(case, best[3]), _described(case)), pictures, _text(places, sweeps[0][1].predicted)
    )


def _places(case: BlockCase, every: Floats, quick: bool) -> tuple[Floats, Floats]:
    """Places (k, 2) for the point, and the best minimum (k,) with a coarse grid of Jacobians at each place."""
    chosen = every[:: 120 if quick else 8]
    values = np.linspace(-3.0, 3.0, 7 if quick else 11)
    return chosen, np.array([best_jacobian(sweep_at(case, x, PLACES_RADIUS), values)[0] for x in chosen])


def _text(places: tuple[Floats, Floats], predicted: Floats) -> str:
    best = int(np.argmax(places[1]))
    return (
        f"The standard motion's own Jacobian at the worst cell has J11 = {predicted[0, 0]:.2f}. At other places than "
        f"the worst cell, with R_l = {PLACES_RADIUS} and a coarse grid of Jacobians, one point reaches at most "
        f"{places[1][best]:.3f}, at {_pair(places[0][best])}; it makes the mesh valid from "
        f"{np.mean(places[1] > 0):.0%} of the places tried."
    )


def _compared(case: BlockCase, best: float) -> Table:
    """Table 5.4, and the rounds of imposed Jacobians."""
    thesis = ExplicitSettings(enrichment_radius=0.5, threshold=0.19, metric="size", relaxation=1.3)
    explicit = predicted_iterations(case.problem, thesis, case.field)
    rows: list[list[Cell]] = [
        ["standard", -0.25, case.smallest(case.problem.standard), 0],
        ["imposed gradient, parametric study", 0.26, best, 1],
        ["explicit iterations (predicted)", 0.19, explicit.history[explicit.best].predicted, explicit.best],
        ["explicit iterations (actual)", None, case.smallest(explicit.points), explicit.best],
    ]
    for decomposition in ("eigen", "polar"):
        settings = ImposedSettings(enrichment_radius=0.5, threshold=0.19, correct_cell=CELL_CORRECTIONS[decomposition])
        found = imposed_jacobians(case.problem, case.mesh, settings)
        name = f"imposed gradients of cells corrected by {decomposition}, in rounds"
        rows.append([name, None, case.smallest(found.points), len(found.enrichment_points)])
    return Table(
        ("motion", "thesis", "minimum size", "points"),
        rows,
        "Table 5.4, and methods that need no parametric study.",
        digits=3,
    )


def _described(case: BlockCase) -> Table:
    """Table 5.1. Relative to itself a mesh has size 1 everywhere, so its quality must be that against ideal cells."""
    p = case.problem
    ideal = np.full(len(p.cells), 0.5 * np.sqrt(3.0) * SPACING**2)
    quality = cell_quality(p.start, p.cells, ideal).metric("size-skew")
    rows: list[list[Cell]] = [
        ["nodes", 751, len(p.start)],
        ["static nodes", 100, int(p.held.sum()) - len(case.body)],
        ["moving nodes", 16, len(case.body)],
        ["mean quality", 0.94, float(quality.mean())],
        ["minimum quality", 0.67, float(quality.min())],
    ]
    caption = "Table 5.1: the mesh before the motion; quality: size-skew against equilateral triangles of side 0.04."
    return Table(("", "thesis", "ours"), rows, caption, digits=3)


def _pair(x: Floats) -> str:
    return f"({x[0]:.2f}, {x[1]:.2f})"


def _meshes(figure: Any, case: BlockCase, best: Any) -> None:
    radius, sweep, jacobian, _ = best
    axes = figure.subplots(1, 4)
    added = sweep.displacement @ (jacobian - sweep.predicted).T
    total = case.field.displacement(case.problem.start) + added
    draw_mesh(axes[0], case, case.problem.standard, "standard, R = 0.5")
    draw_mesh(axes[1], case, case.moved(total), f"one imposed Jacobian, R_l = {radius}")
    x = case.problem.start
    for ax, values, name in zip(axes[2:], total.T, ("x", "y"), strict=True):
        shown = ax.tricontourf(x[:, 0], x[:, 1], case.triangles, values, 12, cmap="coolwarm")
        ax.set_aspect("equal")
        ax.set_axis_off()
        ax.set_title(f"{name} displacement", fontsize=9)
        figure.colorbar(
            shown,
            ax=ax,
            location="bottom",
            shrink=0.8,
            ticks=np.linspace(values.min(), values.max(), 3),
            format="%.2f",
        )


def _responses(figure: Any, rows: Any, sweeps: Any, places: tuple[Floats, Floats]) -> None:
    quality, jacobians, where = figure.subplots(1, 3)
    quality.plot(RADII, [s[3] for s in sweeps], ".-")
    quality.set(xlabel="R_l", title="best minimum size", ylim=(-0.3, 0.35))
    quality.axhline(0, color="k", lw=0.6)
    jacobians.plot(RADII, [row[1:5] for row in rows], ".-", label=["J11", "J12", "J21", "J22"])
    jacobians.set(xlabel="R_l", title="its Jacobian")
    jacobians.legend(fontsize=7)
    shown = where.scatter(*places[0].T, c=places[1], s=14, cmap="viridis", vmin=-0.3, vmax=0.3)
    where.set(title=f"best minimum by place, R_l = {PLACES_RADIUS}", aspect="equal")
    figure.colorbar(shown, ax=where, shrink=0.8)


def claims(outcome: Outcome) -> None:
    response, compared, described = outcome.tables
    minima = np.array(response.column("refined"), dtype=float)
    assert minima.max() > 0.12  # on the coarse grid of a quick run; 0.24 on the thesis'
    assert minima[0] < minima[2:].max()
    reached = dict(zip(compared.column("motion"), compared.column("minimum size"), strict=True))
    assert -0.25 < reached["standard"] < -0.2
    assert reached["imposed gradients of cells corrected by polar, in rounds"] > 0.15
    for _, thesis, ours in described.rows:
        assert abs(float(thesis) - float(ours)) <= 0.1 * float(thesis)


STUDY = Study(
    "Which Jacobian must be imposed in 2D, with which radius and at which place?",
    "Tables 5.1–5.4, Figs 5.4–5.6 (equations 5.4–5.6)",
    run,
    claims,
    (
        "mesh_motion_numerics.correction.enrichment.imposed_jacobian.impose",
        "mesh_motion_numerics.correction.enrichment.imposed_jacobian.imposed_jacobians",
        "mesh_motion_numerics.correction.enrichment.space.EnrichmentSpace",
    ),
)
