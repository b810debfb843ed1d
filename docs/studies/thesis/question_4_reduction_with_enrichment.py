"""Research question 4 of the thesis: control-point reduction together with enrichment.

The standard motion starts from few nodes (grouped-circular) and is corrected near the surface; then its quality is
predicted and corrected. A separate question is on which nodes the enrichment functions ψ must vanish.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

import numpy as np
from mesh_motion_numerics.arrays import bytes_of
from mesh_motion_numerics.correction.correction import correct
from mesh_motion_numerics.correction.correction_problem import CorrectionProblem
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import Factorization, Interpolant, factorize
from mesh_motion_numerics.interpolation.two_scale.interpolant import AnyInterpolant, TwoScaleInterpolant
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.quality.metrics import reference_sizes
from mesh_motion_numerics.reduction import REDUCTIONS
from mesh_motion_numerics.reduction.reduced_motion import boundary_spacing, near_surface_radius
from mesh_motion_protocol.errors import QualityRefused
from numpy.typing import NDArray

from docs.studies.moved_bodies import Turn, stored
from docs.studies.study import Cell, Outcome, Picture, Study, Table
from docs.studies.thesis._boundary_motions import MeshMotion, layered, mesh_motion, surface_problem, wing

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

REDUCTION = "grouped-circular"
TOLERANCES = (0.0, 1e-3, 1e-2, 1e-1)
CORRECTIONS = ("explicit", "enrichment", "optimised")
#: Where ψ vanishes.
ALL, NEAR, REDUCED, NOWHERE = "all nodes", "reduced set, then near the surface", "reduced set", "nowhere: H alone"
PLACE_LABELS = ("all nodes", "reduced set,\nthen near surface", "reduced set", "nowhere")
#: The tolerance at which the four are compared.
PSI_TOLERANCE = 1e-2


@dataclass(frozen=True, eq=False)
class Boundary:
    """Interpolations that remove an enrichment function's boundary values, one after the other."""

    control_points: Floats
    parts: tuple[tuple[Indices, Factorization], ...]
    support_radius: float
    nbytes: int = 0

    def solve(self, values: Floats) -> TwoScaleInterpolant:
        """A sum that interpolates the (nb, k) values at the parts' nodes; zero without parts."""
        left, levels = values.copy(), list[Interpolant]()
        for rows, factorization in self.parts:
            levels.append(cast(Interpolant, factorization.solve(left[rows])))
            left -= evaluation.displacement(levels[-1], self.control_points)
        if not levels:
            one = factorize(self.control_points[:1], support_radius=self.support_radius)
            levels.append(one.solve(np.zeros_like(values[:1])))
        return TwoScaleInterpolant(levels[0], tuple(levels[1:]))


class ReducedMotion:
    """The standard motion of a case from the nodes for a tolerance (0: from all), exact at the boundary."""

    def __init__(self, case: MeshMotion, tolerance: float) -> None:
        self.case, self.points = case, case.mesh.points[case.boundary]
        self.selected = np.arange(len(self.points))
        levels: tuple[AnyInterpolant, ...] = case.all_nodes()
        if tolerance:
            reduced = REDUCTIONS[REDUCTION](case.problem(tolerance))
            self.selected, levels = reduced.selected, case.corrected(reduced)
        self.standard = case.snapped(case.displaced(levels))
        self.quality = case.quality(self.standard)

    def boundary(self, where: str) -> Boundary:
        """ψ vanishing there."""
        return psi_boundary(self.points, self.selected, self.case.displacement, self.case.support_radius, where)

    def corrected(self, correction: str, where: str) -> float:
        """Minimum size-skew after a correction to the maximum; for a refused motion the best one found."""
        mesh = self.case.mesh
        held = np.zeros(len(mesh.points), dtype=bool)
        held[self.case.boundary] = True
        sizes = reference_sizes(mesh.points, mesh.cells)
        problem = CorrectionProblem(mesh.points, self.standard, held, mesh.cells, sizes, self.boundary(where))
        method = Method(
            correction=correction,
            quality_metric="size-skew",
            quality_threshold=0.95,
            correction_target="maximum",
            enrichment_radius=self.case.support_radius,
        )
        try:
            return correct(problem, method).minimum
        except QualityRefused as refusal:
            return float(refusal.best or 0.0)


def psi_boundary(points: Floats, selected: Indices, displacement: Floats, radius: float, where: str) -> Boundary:
    """Factorizations for ψ that vanish as ``where`` says, of boundary nodes (nb, d) with a displacement (nb, d)."""
    every = np.arange(len(points))
    parts: list[tuple[Indices, Factorization]] = []
    if where == ALL:
        parts.append((every, factorize(points, support_radius=radius)))
    if where in {NEAR, REDUCED}:
        parts.append((selected, factorize(points[selected], support_radius=radius)))
    if where == NEAR:
        moving = np.linalg.norm(displacement, axis=1) > 0.0
        near = near_surface_radius(boundary_spacing(points[moving]), 0.0, radius)
        parts.append((every, factorize(points, support_radius=near)))
    return Boundary(points, tuple(parts), radius)


def _plane(name: str, patch: str, shift: tuple[float, float], degrees: float) -> MeshMotion:
    """A body of a mesh of the tests, moved rigidly."""
    mesh = stored(f"tests/references/{name}")
    body = mesh.points[mesh.patches[patch].nodes]
    return mesh_motion(f"{shift} {degrees:+.0f}°", mesh, {patch: Turn(shift, degrees)(body) - body}, 0.5)


def _box(shift: tuple[float, float, float], degrees: float) -> MeshMotion:
    """The box of the tests' 3D mesh, moved rigidly and bent by 0.1."""
    mesh = stored("tests/references/correction_box")
    body = mesh.points[mesh.patches["body"].nodes]
    moved = Turn(shift, degrees)(body) - body
    moved[:, 1] += 0.1 * ((body[:, 2] - 0.4) / 0.2) ** 2
    return mesh_motion(f"box {shift} {degrees:+.0f}°", mesh, {"body": moved}, 0.5)


def _layered(first_layer: float, shift: tuple[float, float], degrees: float) -> MeshMotion:
    """The ellipse with layers, moved rigidly."""
    mesh = layered(first_layer).mesh
    body = mesh.points[mesh.patches["body"].nodes]
    return mesh_motion("layers", mesh, {"body": Turn(shift, degrees)(body) - body}, 0.5)


def families(quick: bool) -> dict[str, list[MeshMotion]]:
    """The cases by family."""
    named = [("thesis_block", "block", (-0.3, 0.0), 0.0), ("correction_slab", "body", (-0.2, -0.2), 60.0)]
    if not quick:
        named += [("thesis_block", "block", (-0.25, -0.25), 0.0), ("thesis_block", "block", (-0.38, 0.0), 0.0)]
        named += [("thesis_block", "block", (0.0, 0.0), 90.0), ("thesis_block", "block", (0.0, 0.0), 180.0)]
        rng = np.random.default_rng(20)
        for _ in range(8):
            shift, degrees = rng.uniform(-0.3, 0.3, 2), float(rng.uniform(-90, 90))
            named.append(("thesis_block", "block", (float(shift[0]), float(shift[1])), degrees))
    found = {"2D": [_plane(*each) for each in named]}
    if not quick:
        found["2D, thin layers"] = [_layered(2e-4, (-0.25, 0.1), -50.0), _layered(2e-4, (0.15, 0.1), 30.0)]
        found["3D"] = [_box((0.25, 0.0, 0.0), 0.0), _box((0.15, 0.1, 0.0), 60.0), wing(1.0)]
    return found


def _score(values: Sequence[float]) -> list[Cell]:
    """Mean minimum (0 for an invalid mesh), and number of valid meshes."""
    return [float(np.mean(np.maximum(values, 0.0))), f"{sum(v > 0 for v in values)}/{len(values)}"]


def _by_tolerance(cases: dict[str, list[MeshMotion]], tolerances: Sequence[float]) -> Table:
    """Table of the quality without and with corrections; ψ vanishes on all nodes."""
    rows: list[list[Cell]] = []
    for family, members in cases.items():
        for tolerance in tolerances:
            motions = [ReducedMotion(case, tolerance) for case in members]
            share = float(np.mean([len(m.selected) / len(m.points) for m in motions]))
            row: list[Cell] = [family, f"{tolerance:g}" if tolerance else "none: all nodes", share]
            row += [float(np.mean([m.quality for m in motions]))]
            for correction in CORRECTIONS:
                row += _score([m.corrected(correction, ALL) for m in motions])
            rows.append(row)
    columns = ["cases", "tolerance", "share of the nodes", "standard"]
    columns += [head for c in CORRECTIONS for head in (c, f"{c}: valid")]
    caption = "Mean of the minimum size-skew: predicted for the standard motion (signed), and corrected (invalid: 0)."
    return Table(columns, rows, caption, digits=3)


def _by_place(cases: dict[str, list[MeshMotion]]) -> Table:
    """Table of the nodes on which ψ vanishes, at one tolerance."""
    rows: list[list[Cell]] = []
    for family, members in cases.items():
        motions = [ReducedMotion(case, PSI_TOLERANCE) for case in members]
        for where in (ALL, NEAR, REDUCED, NOWHERE):
            row: list[Cell] = [family, where]
            for correction in ("explicit", "enrichment"):
                row += _score([m.corrected(correction, where) for m in motions])
            rows.append(row)
    columns = ("cases", "ψ vanishes on", "explicit", "explicit: valid", "enrichment", "enrichment: valid")
    return Table(columns, rows, f"Where ψ vanishes; standard motion reduced to {PSI_TOLERANCE:g}.", digits=3)


def _cost(quick: bool) -> Table:
    """Cost of ψ of 20 points on a bending wing's boundary, without a volume mesh."""
    problem = surface_problem(0.03 if quick else 0.0105, tolerance=PSI_TOLERANCE)
    selected = REDUCTIONS[REDUCTION](problem).selected
    columns = np.ones((problem.n_points, 120)) * np.cos(np.arange(120) * problem.points[:, :1])
    rows: list[list[Cell]] = []
    for where in (ALL, NEAR, REDUCED):
        began = time.process_time()
        boundary = psi_boundary(problem.points, selected, problem.displacement, problem.support_radius, where)
        made = time.process_time()
        levels = boundary.solve(columns)
        seconds = [made - began, time.process_time() - made]
        left = columns - evaluation.displacement(levels, problem.points)
        stored_bytes = sum(bytes_of(factorization) for _, factorization in boundary.parts) / 2**20
        rows.append([where, *seconds, stored_bytes, float(np.abs(left).max())])
    caption = f"{problem.n_points} boundary nodes, {len(selected)} chosen; 20 points in 3D with H1 and H2, 120 columns."
    names = ("ψ vanishes on", "factorize, CPU s", "solve, CPU s", "factors, MiB", "left at a node")
    return Table(names, rows, caption, digits=3)


def run(quick: bool) -> Outcome:
    """Reduced motions corrected, ψ on different nodes, and the cost of that."""
    cases = families(quick)
    tables = [_by_tolerance(cases, (0.0, 1e-2) if quick else TOLERANCES), _by_place(cases), _cost(quick)]
    picture = Picture(partial(draw, by_tolerance=tables[0], by_place=tables[1]), size=(10.0, 3.8))
    return Outcome(tables, [picture], _words(*tables))


def draw(figure: Any, by_tolerance: Table, by_place: Table) -> None:
    """Share of the quality with all nodes: left by tolerance, right by the nodes on which ψ vanishes; family means."""
    left, right = figure.subplots(1, 2, sharey=True)
    tolerances = list(dict.fromkeys(by_tolerance.column("tolerance")))
    for number, correction in enumerate(CORRECTIONS):
        left.plot(tolerances, _mean_shares(by_tolerance, correction), "o-", color=f"C{number}", label=correction)
    left.set(xlabel="tolerance of the reduced motion", ylabel="share of all nodes' quality", ylim=(0.0, 1.1))
    places = np.arange(len(PLACE_LABELS))
    for number, correction in enumerate(CORRECTIONS[:2]):
        shares = _mean_shares(by_place, correction)
        right.bar(places + 0.4 * number - 0.2, shares, 0.38, color=f"C{number}", label=correction)
    right.set_xticks(places, PLACE_LABELS)
    right.set(xlabel="ψ vanishes on")
    left.legend(fontsize=8, loc="lower left")
    for axis in (left, right):
        axis.grid(alpha=0.3)


def _mean_shares(table: Table, column: str) -> list[float]:
    """Share of each family's first row, one value for each second cell: the mean over the families."""
    families = dict.fromkeys(row[0] for row in table.rows)
    place = list(table.columns).index(column)
    values = np.array([[float(row[place] or 0.0) for row in table.rows if row[0] == f] for f in families])
    return [float(share) for share in (values / values[:, :1]).mean(axis=0)]


def _worst_ratio(table: Table, column: str, allowed: Sequence[str]) -> float:
    """Least share of each family's first value in the allowed rows, which are chosen by their second cell."""
    place = list(table.columns).index(column)
    first: dict[str, float] = {}
    ratios = []
    for row in table.rows:
        value = float(row[place] or 0.0)
        first.setdefault(str(row[0]), value)
        if str(row[1]) in allowed and first[str(row[0])] > 0:
            ratios.append(value / first[str(row[0])])
    return min(ratios)


def _words(by_tolerance: Table, by_place: Table, cost: Table) -> str:
    """The answer."""
    tight, all_of_them = ("0.001", "0.01"), ("0.001", "0.01", "0.1")
    kept = {c: _worst_ratio(by_tolerance, c, tight) for c in CORRECTIONS}
    loose = {c: _worst_ratio(by_tolerance, c, all_of_them) for c in CORRECTIONS}
    moved = max(
        abs(float(row[3] or 0.0) - float(base[3] or 0.0))
        for base in by_tolerance.rows
        if base[1] == "none: all nodes"
        for row in by_tolerance.rows
        if row[0] == base[0] and row[1] in tight
    )
    share = {c: {w: _worst_ratio(by_place, c, (w,)) for w in (NEAR, REDUCED, NOWHERE)} for c in CORRECTIONS[:2]}
    seconds = {row[0]: float(row[1] or 0.0) + float(row[2] or 0.0) for row in cost.rows}
    return (
        f"**Predicted quality**: to a tolerance of 1e−2 or tighter its mean changes by at most {moved:.2g} in any "
        f"family. **Gain**: share of the quality from all nodes that the corrections keep in the worst family: "
        f"{', '.join(f'{kept[c]:.1%} ({c})' for c in CORRECTIONS)}; at a tolerance of 1e−1 still "
        f"{', '.join(f'{loose[c]:.1%}' for c in CORRECTIONS)}. **Where ψ vanishes**: against all nodes, on the reduced "
        f"set alone explicit iterations keep {share['explicit'][REDUCED]:.0%} and optimised coefficients "
        f"{share['enrichment'][REDUCED]:.0%} in the worst family; with the remaining error interpolated near the "
        f"surface {share['explicit'][NEAR]:.0%} and {share['enrichment'][NEAR]:.0%}; with H alone and the boundary "
        f"nodes held {share['explicit'][NOWHERE]:.0%} and {share['enrichment'][NOWHERE]:.0%}. **Cost**: ψ on all "
        f"nodes takess {seconds[ALL] / seconds[NEAR]:.1f} times the time of the two-level ones and "
        f"{seconds[ALL] / seconds[REDUCED]:.0f} times that of the reduced set."
    )


def claims(outcome: Outcome) -> None:
    """Check that a reduction to 1e-2 keeps prediction and gain, and that explicit iterations need exact ψ."""
    by_tolerance, by_place, cost = outcome.tables
    for correction, least in (("explicit", 0.85), ("enrichment", 0.95), ("optimised", 0.95)):
        assert _worst_ratio(by_tolerance, correction, ("0.001", "0.01")) > least, correction
    assert _worst_ratio(by_place, "explicit", (REDUCED,)) < 0.8
    assert _worst_ratio(by_place, "explicit", (NEAR,)) > _worst_ratio(by_place, "explicit", (REDUCED,))
    assert _worst_ratio(by_place, "enrichment", (NEAR,)) > 0.95
    assert _worst_ratio(by_place, "enrichment", (REDUCED,)) > 0.9
    left = {row[0]: float(row[4] or 0.0) for row in cost.rows}
    assert max(left[ALL], left[NEAR]) < 1e-9 < left[REDUCED]


STUDY = Study(
    title="What does control-point reduction do to the predicted quality, the corrections' gain and the cost?",
    source="Research question 4, unanswered in §6.1 of the thesis",
    run=run,
    claims=claims,
    functions=(
        "mesh_motion_numerics.reduction.reduced_motion.interpolate_reduced",
        "mesh_motion_numerics.correction.enrichment.space.EnrichmentSpace",
        "mesh_motion_numerics.correction.enrichment.explicit_iterations.explicit_iterations",
    ),
)
