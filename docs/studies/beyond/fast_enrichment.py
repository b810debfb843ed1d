"""Gauss–Newton on the enrichment coefficients against L-BFGS: the time to the same minimum quality."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np
from mesh_motion_numerics.blas import one_blas_thread
from mesh_motion_numerics.correction.correction_problem import CorrectionProblem
from mesh_motion_numerics.correction.enrichment.coefficients import (
    optimised_enrichment,
    optimised_placement,
)
from mesh_motion_numerics.correction.enrichment.space import EnrichmentSpace
from mesh_motion_numerics.correction.trial_nodes import Polished, TrialMesh

from docs.studies.beyond._motions import RADIUS, Body, random_motions, stored
from docs.studies.beyond._quasi_newton import VARIABLES, QuasiNewton
from docs.studies.moved_bodies import stored as patched
from docs.studies.refinement import refined
from docs.studies.study import Cell, Outcome, Picture, Study, Table

SAME = 0.99  # of our minimum quality: "the same quality"
_SHARES = (0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 1.0)  # of our minimum, at which the picture shows our time


@dataclass(frozen=True, eq=False)
class Case:
    """A motion, and the numbers of iterations per p-mean that are tried with L-BFGS until one is sufficient."""

    group: str
    name: str
    body: Body
    problem: CorrectionProblem
    points: int
    schedules: dict[str, tuple[int, ...]]

    @property
    def mesh(self) -> TrialMesh:
        return self.body.judge()

    def space(self) -> EnrichmentSpace:
        """The enrichment functions that both methods use."""
        p, quality = self.problem, self.mesh.quality(self.problem.standard)
        placement = optimised_placement(p.start, p.cells, quality, count=self.points, radius=RADIUS)
        return EnrichmentSpace(placement, p.factorization)


@dataclass(frozen=True, eq=False)
class Race:
    """Result of a case: our method, its CPU seconds to the common goal, and L-BFGS by its variables."""

    case: Case
    ours: Polished
    seconds: float
    others: dict[str, QuasiNewton]

    def ratio(self, variables: str) -> float:
        """CPU seconds of L-BFGS over ours; a lower bound if L-BFGS did not reach the goal."""
        return self.others[variables].seconds / self.seconds

    def reached(self, variables: str) -> bool:
        """True if L-BFGS reached our minimum to within a hundredth."""
        return self.others[variables].minimum >= SAME * self.ours.minimum


def _schedules(*scaled: int, orthonormal: tuple[int, ...] = (200, 400, 1000)) -> dict[str, tuple[int, ...]]:
    return {"functions": scaled, "orthonormal": orthonormal}


def cases(quick: bool) -> Iterator[Case]:
    """The cases: named motions, new random ones, two finer meshes, tetrahedra."""
    block, slab, box = (stored(name) for name in ("thesis_block", "correction_slab", "correction_box"))
    plain = _schedules(400, 1200)
    if quick:
        plain = _schedules(600, orthonormal=(200,))
    named = {
        "dx −0.3": (block, (-0.3, 0.0), 0.0),
        "−0.2, −0.2, +60°": (slab, (-0.2, -0.2), 60.0),
        "rotate 180°": (block, (0.0, 0.0), 180.0),
    }
    for name, (body, shift, degrees) in list(named.items())[: 1 if quick else None]:
        yield Case(name, name, body, body.rigid(np.array(shift), degrees), 20, plain)
    if quick:
        return
    for label, body in (("block", block), ("slab", slab)):
        for number, problem in enumerate(random_motions(body, 3, seed=43)):
            yield Case(f"{label}, random", f"{label} {number}", body, problem, 20, plain)
    problem = block.rigid(np.array((-0.3, 0.0)), 0.0)
    yield Case("dx −0.3, 60 points", "dx −0.3, 60 points", block, problem, 60, plain)
    for times, count, schedules in ((1, 2, plain), (2, 1, _schedules(400, orthonormal=(200, 400)))):
        fine = _refined(times)
        label = f"block refined {4**times} ×"
        for number, problem in enumerate(random_motions(fine, count, seed=44)):
            yield Case(f"{label}, random", f"{label} {number}", fine, problem, 20, schedules)
    for number, problem in enumerate(random_motions(box, 3, seed=45)):
        yield Case("3D box, random", f"box {number}", box, problem, 20, _schedules(400, orthonormal=(200, 400)))


def _refined(times: int) -> Body:
    """The thesis' block in a finer mesh."""
    mesh = refined(patched("tests/references/thesis_block"), times)
    moving = next(patch.nodes for patch in mesh.patches.values() if patch.role == "moving")
    outer = np.unique(np.concatenate([patch.nodes for patch in mesh.patches.values() if patch.role == "fixed"]))
    return Body.build(mesh.points, mesh.cells, moving, outer)


def race(case: Case) -> Race:
    """Our method (median of three times), and L-BFGS with the fewest sufficient iterations a p-mean."""
    ours = _timed(case)[0]
    goal = SAME * ours.minimum
    seconds = [
        _timed(case, goal)[1]
    ]  # before, between and after the others, so that other programs on the machine slow all alike
    others = {}
    for variables in VARIABLES:
        for iterations in case.schedules[variables]:
            one = QuasiNewton(case.problem, case.mesh, case.space(), variables)
            others[variables] = one.run(iterations, goal)
            if one.minimum >= goal:
                break
        seconds.append(_timed(case, goal)[1])
    return Race(case, ours, median(seconds), others)


def _timed(case: Case, target: float = np.inf) -> tuple[Polished, float]:
    """Our minimisation and its CPU seconds, including the functions' values."""
    space, p, mesh = case.space(), case.problem, case.mesh
    began = time.process_time()
    found = optimised_enrichment(mesh, p.start, p.standard, space, target=target)
    return found, time.process_time() - began


def run(quick: bool) -> Outcome:
    with one_blas_thread():
        races = [race(case) for case in cases(quick)]
        shown = [races[0]] if quick else [races[1], races[-1]]
        curves = [(each, _our_curve(each)) for each in shown]
    table = Table(_COLUMNS, _rows(races), _CAPTION, digits=3)
    ratios = {variables: [each.ratio(variables) for each in races] for variables in VARIABLES}
    summary = Table(
        ("variables of L-BFGS", "motions", "reached ours − 1 %", "least ratio", "median ratio", "largest ratio"),
        [
            [name, len(races), sum(r.reached(name) for r in races), min(values), median(values), max(values)]
            for name, values in ratios.items()
        ],
        "CPU time of L-BFGS divided by ours, for each motion; if L-BFGS did not reach our quality, its whole CPU time.",
        digits=3,
    )
    return Outcome((table, summary), (Picture(lambda f: _draw(f, curves), _PICTURE, (9.0, 3.4)),))


_COLUMNS = (
    "case",
    "motions",
    "free nodes",
    "our minimum",
    "our CPU ms",
    "L-BFGS: share of ours",
    "evaluations",
    "times our CPU",
    "orthonormal: share of ours",
    "evaluations",
    "times our CPU",
)
_CAPTION = (
    "Means over the motions of a row. The times end at 0.99 of our minimum quality; “>”: in at least one motion "
    "L-BFGS used all allowed iterations and ended below this quality."
)
_PICTURE = (
    "Minimum quality against CPU time, 20 points: the slab, (−0.2, −0.2) and +60°; a random motion of the box in 3D."
)


def _rows(races: list[Race]) -> list[list[Cell]]:
    rows = []
    for group in dict.fromkeys(each.case.group for each in races):
        members = [each for each in races if each.case.group == group]
        body = members[0].case.body
        row: list[Cell] = [group, len(members), int(np.count_nonzero(~body.held))]
        row += [float(np.mean([m.ours.minimum for m in members])), 1e3 * float(np.mean([m.seconds for m in members]))]
        for variables in VARIABLES:
            row.append(float(np.mean([m.others[variables].minimum / m.ours.minimum for m in members])))
            row.append(round(float(np.mean([m.others[variables].evaluations for m in members]))))
            bound = "" if all(m.reached(variables) for m in members) else "> "
            row.append(f"{bound}{np.mean([m.ratio(variables) for m in members]):.3g}")
        rows.append(row)
    return rows


def _our_curve(race: Race) -> list[tuple[float, float]]:
    """(CPU seconds, minimum quality) of runs that stop at shares of our final quality."""
    found = [_timed(race.case, share * race.ours.minimum if share < 1.0 else np.inf) for share in _SHARES]
    return [(seconds, each.minimum) for each, seconds in found]


def _draw(figure: Any, curves: list[tuple[Race, list[tuple[float, float]]]]) -> None:
    for ax, (each, ours) in zip(np.atleast_1d(figure.subplots(1, len(curves))), curves, strict=True):
        ax.plot(*np.transpose(ours), "o-", ms=3, color="#c1440e", label="Gauss–Newton")
        styles = (("functions", "L-BFGS", "#808080"), ("orthonormal", "L-BFGS, orthonormal basis", "#1b6ca8"))
        for variables, label, colour in styles:
            ax.plot(*np.transpose(each.others[variables].trace), color=colour, lw=1.3, label=label)
        ax.axhline(each.ours.minimum, color="k", lw=0.5, ls=":")
        low = min(0.0, each.ours.minimum)
        ax.set(xscale="log", xlabel="CPU seconds", ylim=(low, 1.1 * each.ours.minimum), title=each.case.group)
        ax.legend(fontsize=8, loc="lower right")
    figure.axes[0].set_ylabel("minimum size-skew")


def claims(outcome: Outcome) -> None:
    """Check that ours is ten times as fast as L-BFGS on the coefficients (a few times in our basis), and not worse."""
    plain, orthonormal = (float(row[4] or 0.0) for row in outcome.tables[1].rows)
    assert plain >= 10.0
    assert orthonormal >= 2.5
    for row in outcome.tables[0].rows:
        assert float(row[5] or 0.0) < 1.02, row[0]
        assert float(row[8] or 0.0) < 1.02, row[0]


STUDY = Study(
    "How much faster is Gauss–Newton on the enrichment coefficients than L-BFGS, at the same quality?",
    "Enrichment optimised for the worst cell",
    run,
    claims,
    (
        "mesh_motion_numerics.correction.enrichment.coefficients.optimised_enrichment",
        "mesh_motion_numerics.correction.enrichment.space.EnrichmentSpace",
    ),
)
