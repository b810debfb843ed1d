"""Are the default radii within five per cent of the best?

Six meshes with motions that were not used to tune a rule: the minimum size-skew after one step from the reference mesh,
for each radius of a sweep and for the radii that the server chooses. Corrections act on every motion (the threshold is
1): otherwise a radius with a bad plain motion would have an advantage, because only its mesh would be corrected.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from mesh_motion_numerics.interpolation.factor_source import MakeEachTime
from mesh_motion_numerics.interpolation.support_radius import suggest_support_radius, widest_ball
from mesh_motion_numerics.mesh.roles import BoundaryRoles
from mesh_motion_numerics.stopwatch import Stopwatch
from mesh_motion_protocol.errors import QualityRefused
from numpy.typing import NDArray

from docs.studies.moved_bodies import ROOT, StoredMesh, Turn, stored
from docs.studies.study import Cell, Outcome, Picture, Study, Table

Floats = NDArray[np.float64]
Motion = Callable[[Floats], Floats]

SUPPORT = {
    "none": (0.15, 0.2, 0.3, 0.5, 1.0, 2.5, 5.0),
    "explicit": (0.15, 0.2, 0.3, 0.5, 1.0, 2.5, 5.0),
    "enrichment": (0.3, 0.5, 1.0, 5.0),
    "optimised": (0.3, 0.5, 1.0, 5.0),
}
"""R / L by correction, L the longest side of the domain."""
ENRICHMENT = (0.25, 0.5, 1.0, 2.0, 4.0)
"""R_l over its default."""
CHOICES = ("mesh", "motion")
CANDIDATES = (0.625, 1.0, 1.75)
"""Diameters of the largest ball between the boundaries; R is above them but in far fields."""
CLEARLY = 0.02
"""The share of the larger minimum quality that another radius has to gain over the mesh's own."""
WITHIN = 0.95


def each(left: Turn, right: Turn) -> Motion:
    """Two bodies, left and right of the middle, with a motion each."""

    def motion(points: Floats) -> Floats:
        out, on_left = points.copy(), points[:, 0] < 0.5
        out[on_left], out[~on_left] = left(points[on_left]), right(points[~on_left])
        return out

    return motion


def frame(example: str, number: int) -> Motion:
    """A step of an example's motion."""
    with np.load(ROOT / "examples" / example / "motion.npz") as data:
        displacement = data["displacement"][number][np.argsort(data["node_ids"])]
    return lambda points: points + displacement


def cases() -> dict[str, tuple[str, dict[str, Motion]]]:
    """Mesh and motions by a name."""
    return {
        "block, triangles": (
            "tests/references/thesis_block",
            {
                "(0.12, −0.2), +25°": Turn((0.12, -0.2), 25.0),
                "+50°": Turn((0.0, 0.0), 50.0),
                "(−0.2, 0.22), −40°": Turn((-0.2, 0.22), -40.0),
            },
        ),
        "slab, triangles": (
            "tests/references/correction_slab",
            {
                "(0.15, 0.1), −35°": Turn((0.15, 0.1), -35.0),
                "(0, −0.25)": Turn((0.0, -0.25)),
                "(0.2, 0.15), −65°": Turn((0.2, 0.15), -65.0),
            },
        ),
        "two blocks, triangles": (
            "tests/references/correction_two_blocks",
            {
                "+40° and −40°": each(Turn((0.0, 0.0), 40.0), Turn((0.0, 0.0), -40.0)),
                "past each other by 0.24": each(Turn((0.0, 0.12)), Turn((0.0, -0.12))),
                "together by 0.22": each(Turn((0.11, 0.0)), Turn((-0.11, 0.0))),
            },
        ),
        "flag, quads and triangles": (
            "examples/turek_hron_flag/mesh",
            {"down, 83 mm": frame("turek_hron_flag", 24), "up, 47 mm": frame("turek_hron_flag", 2)},
        ),
        "box, hexahedra": (
            "examples/hexahedral_box/mesh",
            {
                "(−0.1, 0.15, 0.05), −35°": Turn((-0.1, 0.15, 0.05), -35.0, axis=(1.0, 0.0, 2.0)),
                "(0.12, 0.12, 0), 50°": Turn((0.12, 0.12, 0.0), 50.0),
            },
        ),
        "wing, tetrahedra": (
            "examples/tapered_wing/mesh",
            {"bend, a fifth": frame("tapered_wing", 1), "up by 0.1": Turn((0.0, 0.1, 0.0))},
        ),
    }


@dataclass(frozen=True)
class Sweep:
    """Qualities of one motion over a radius.

    Attributes
    ----------
    radii : tuple of float
        Radii as multiples of their unit.
    values : tuple of float
        Minimum size-skew with each.
    chosen : tuple of float
        With R chosen from the mesh, as the server does, and from the motion.
    """

    mesh: str
    motion: str
    correction: str
    radii: tuple[float, ...]
    values: tuple[float, ...]
    chosen: tuple[float, ...]

    @property
    def best(self) -> float:
        return float(np.nanmax([*self.values, *self.chosen]))

    def share(self, value: float) -> float:
        """Share of the best; 0 for an invalid mesh."""
        return float(np.nan_to_num(max(value, 0.0))) / self.best


def quality(mesh: str, motion: Motion, correction: str, **choices: Any) -> float:
    """Minimum size-skew after a step; for a refused motion the best one found."""
    threshold = 0.2 if correction == "none" else 1.0
    model = stored(mesh).model(allow_invalid=True, correction=correction, quality_threshold=threshold, **choices)
    try:
        return model.move(model.points, motion(model.points[model.roles.moving])).corrected.metric.min
    except QualityRefused as refusal:
        return float("nan") if refusal.best is None else refusal.best


def candidates(mesh: StoredMesh) -> tuple[float, ...]:
    """The mesh's own radius, and smaller ones near the width of the largest gap, descending."""
    roles = BoundaryRoles.from_patches(mesh.patches)
    own, widest = suggest_support_radius(mesh.points, roles), widest_ball(mesh.points, roles)
    rounded = {float(f"{share * widest:.2g}") for share in CANDIDATES}
    return (own, *sorted((radius for radius in rounded if 0.0 < radius < own), reverse=True))


def from_motion(mesh: str, motion: Motion) -> float:
    """The radius with the best predicted motion; the mesh's own unless another one is clearly better."""
    found: dict[float, float] = {}
    for radius in candidates(stored(mesh)):
        model = stored(mesh).model(support_radius=radius)
        targets = motion(model.points[model.roles.moving])
        trial = model.standard_motion.trial(model.points, targets, MakeEachTime(), Stopwatch())
        found[radius] = model.summary(trial.points).metric.min
    own, best = next(iter(found)), max(found, key=lambda radius: found[radius])
    before, after = found[own], found[best]
    return best if after - before > CLEARLY * max(abs(before), abs(after)) else own


def over_support(name: str, what: str, mesh: str, motion: Motion, correction: str) -> Sweep:
    """Qualities over R, and with R from the mesh and from the motion; R_l has its default."""
    length = float(np.ptp(stored(mesh).points, axis=0).max())
    radii = SUPPORT[correction]
    values = tuple(quality(mesh, motion, correction, support_radius=r * length) for r in radii)
    chosen = (quality(mesh, motion, correction), quality(mesh, motion, correction, **_radii(mesh, motion)))
    return Sweep(name, what, correction, radii, values, chosen)


def _radii(mesh: str, motion: Motion) -> dict[str, float]:
    """R from the motion, and R_l at its default, at most R."""
    radius = from_motion(mesh, motion)
    default = float(stored(mesh).model().method.enrichment_radius or 0.0)
    return {"support_radius": radius, "enrichment_radius": min(default, radius)}


def over_enrichment(name: str, what: str, mesh: str, motion: Motion, correction: str) -> Sweep:
    """Qualities over R_l, the last of them R; R from the mesh."""
    method = stored(mesh).model().method
    default, radius = float(method.enrichment_radius or 0.0), float(method.support_radius or 0.0)
    radii = (*ENRICHMENT, radius / default)
    values = tuple(quality(mesh, motion, correction, enrichment_radius=r * default) for r in radii)
    return Sweep(name, what, correction, radii, values, (values[ENRICHMENT.index(1.0)],))


def run(quick: bool) -> Outcome:
    """Both sweeps."""
    chosen = cases()
    if quick:
        chosen = {name: (mesh, dict(list(motions.items())[1:])) for name, (mesh, motions) in list(chosen.items())[2:3]}
    support, enrichment = [], []
    for name, (mesh, motions) in chosen.items():
        for what, motion in motions.items():
            support += [over_support(name, what, mesh, motion, c) for c in list(SUPPORT)[: 2 if quick else 4]]
            for correction in ("explicit",) if quick else ("explicit", "enrichment"):
                enrichment.append(over_enrichment(name, what, mesh, motion, correction))
    tables = [_summary(support), _by_motion(support), _of_enrichment(enrichment)]
    return Outcome(tables, [Picture(partial(draw, support=support, enrichment=enrichment), size=(9.0, 3.6))])


def _shares(sweeps: Sequence[Sweep], which: int) -> list[float]:
    """Shares of the best that one rule reaches."""
    return [sweep.share(sweep.chosen[which]) for sweep in sweeps]


def _score(shares: Sequence[float]) -> list[Cell]:
    """The number within five per cent, the mean and the least."""
    return [f"{sum(s >= WITHIN for s in shares)} of {len(shares)}", float(np.mean(shares)), min(shares)]


def _summary(support: Sequence[Sweep]) -> Table:
    """Table of the support radius by correction and by rule."""
    rows: list[list[Cell]] = []
    for correction in dict.fromkeys(sweep.correction for sweep in support):
        mine = [sweep for sweep in support if sweep.correction == correction]
        for number, choice in enumerate(CHOICES):
            rows.append([correction, f"the {choice}", *_score(_shares(mine, number))])
    columns = ("correction", "R chosen from", "within 5 % of the best", "mean share of the best", "least")
    return Table(columns, rows, "Support radius.", digits=3)


def _by_motion(support: Sequence[Sweep]) -> Table:
    """Best quality and shares, one row for each motion."""
    corrections = list(dict.fromkeys(sweep.correction for sweep in support))
    rows: list[list[Cell]] = []
    for mesh, motion in dict.fromkeys((sweep.mesh, sweep.motion) for sweep in support):
        mine = {sweep.correction: sweep for sweep in support if (sweep.mesh, sweep.motion) == (mesh, motion)}
        row: list[Cell] = [mesh, motion]
        for correction in corrections:
            sweep = mine[correction]
            row += [sweep.best, " / ".join(f"{sweep.share(value):.2f}" for value in sweep.chosen)]
        rows.append(row)
    heads = [head for c in corrections for head in (f"{c}: best", f"{c}: shares")]
    caption = "Best quality over all R, and its share that the R from the mesh / from the motion reaches."
    return Table(("mesh", "motion", *heads), rows, caption, digits=3)


def _of_enrichment(enrichment: Sequence[Sweep]) -> Table:
    """Mean share of the best by R_l."""
    rows: list[list[Cell]] = []
    for correction in dict.fromkeys(sweep.correction for sweep in enrichment):
        mine = [sweep for sweep in enrichment if sweep.correction == correction]
        means = np.mean([[sweep.share(value) for value in sweep.values] for sweep in mine], axis=0)
        rows.append([correction, *means.tolist(), *_score(_shares(mine, 0))])
    heads = (*(f"R_l/2H {r:g}" for r in ENRICHMENT), "R_l = R", "2H: within 5 %", "2H: mean", "2H: least")
    return Table(("correction", *heads), rows, "Enrichment radius: mean share of the best, R from the mesh.", digits=3)


def draw(figure: Any, support: Sequence[Sweep], enrichment: Sequence[Sweep]) -> None:
    """Mean share of the best against the radius, by correction."""
    axes = figure.subplots(1, 2, sharey=True)
    for axis, sweeps, label in ((axes[0], support, "R / L"), (axes[1], enrichment, "$R_l$ / 2H")):
        for number, correction in enumerate(SUPPORT):
            mine = [sweep for sweep in sweeps if sweep.correction == correction]
            if mine:
                radii = mine[0].radii if sweeps is support else ENRICHMENT
                shares = np.mean([[s.share(v) for v in s.values[: len(radii)]] for s in mine], axis=0)
                axis.semilogx(radii, shares, "o-", color=f"C{number}", label=correction)
        ticks = SUPPORT["none"] if sweeps is support else ENRICHMENT
        axis.set(xlabel=label, ylim=(0.0, 1.05))
        axis.set_xticks(ticks, [f"{r:g}" for r in ticks])
        axis.minorticks_off()
        axis.grid(alpha=0.3)
    axes[0].axvline(2.5, color="0.5", linestyle="--", label="default")
    axes[1].axvline(1.0, color="0.5", linestyle="--")
    axes[0].set_ylabel("mean share of the best")
    axes[0].legend(fontsize=8, loc="lower right")


def claims(outcome: Outcome) -> None:
    """Check that R from the motion is within 5 % of the best on average, and that as R_l 2H is far better than R."""
    summary, _, of_enrichment = outcome.tables
    for correction, source, _, mean, least in summary.rows:
        if source == "the motion" or correction in {"enrichment", "optimised"}:
            assert mean >= WITHIN, (correction, mean)
            assert least >= 0.75, (correction, least)
    explicit = dict(zip(of_enrichment.columns, of_enrichment.rows[0], strict=True))
    assert explicit["2H: mean"] > explicit["R_l = R"] + 0.1


STUDY = Study(
    title="Are the default radii within five per cent of the best?",
    source="Support radius and enrichment radius if none is given",
    run=run,
    claims=claims,
    functions=(
        "mesh_motion_numerics.interpolation.support_radius.suggest_support_radius",
        "mesh_motion_numerics.interpolation.support_radius.suggest_enrichment_radius",
        "docs.studies.beyond.default_radii.from_motion",
    ),
)
