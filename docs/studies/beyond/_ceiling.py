"""The best minimum quality of a motion that we can find at any cost: many starts, a long descent, a climb.

No method proves a maximum here, so "best known" is the best result of all tried methods. Every start is untangled and
descends twelve p-means up to p = 3000, each until nothing is gained. The best of the ends climbs the minimum itself
(:mod:`._climb`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mesh_motion_numerics.blas import one_blas_thread
from mesh_motion_numerics.correction.correction import correct
from mesh_motion_numerics.correction.distortion import PNorm
from mesh_motion_numerics.correction.free_region import FreeRegion
from mesh_motion_numerics.correction.newton import Accuracy, newton
from mesh_motion_numerics.correction.trial_nodes import TrialMesh, region_quality, untangle
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.method import Method
from numpy.typing import NDArray

from docs.studies.beyond._cell_types import KINDS, graded
from docs.studies.beyond._climb import climbed, shortest
from docs.studies.beyond._motions import Body, stored
from docs.studies.moved_bodies import Turn
from docs.studies.study import Cell, Table

__all__ = ["Ceiling", "ceiling", "ceilings", "draw_shares", "shares_table"]

Floats = NDArray[np.float64]

_LEVELS = ((2, 1), (4, 1.5), (8, 2), (14, 3), (24, 4), (40, 6), (60, 8), (100, 12), (150, 16), (400, 40), (1000, 100))
LONG = tuple(PNorm(p, m, of="cells") for p, m in (*_LEVELS, (3000, 300)))
_ITERATIONS = 60
_SETTLED = Accuracy(full_step_gain=1e-6, least_decrement=1e-6, least_gain=1e-9, cg_reduction=0.05, cg_iterations=200)
_ACCURACY = {2: replace(_SETTLED, direct_unknowns=4000), 3: _SETTLED}  # in 2D a factorization is cheaper than that
_SHAKE = 0.3  # of an edge
_METHOD = Method(quality_metric="size-skew")


@dataclass(frozen=True)
class Ceiling:
    """Minimum size-skew of one motion.

    Attributes
    ----------
    standard : float
        Minimum size-skew of the standard motion.
    reached : float
        That of the default correction.
    ends : dict
        Those of the long descent, by start.
    climbed : float
        That of the climb from the best of all these.
    """

    standard: float
    reached: float
    ends: dict[str, float]
    climbed: float

    @property
    def best(self) -> float:
        """The best known."""
        return max(self.reached, self.climbed, *self.ends.values())

    @property
    def share(self) -> float:
        """Share of the best known quality that the default correction reaches."""
        return self.reached / self.best


def ceilings(meshes: Mapping[str, tuple[int, int]], quick: bool, *, starts: int, seed: int) -> dict[str, list[Ceiling]]:
    """The ceilings of new random motions of each mesh; their number is given for the full and for the quick study."""
    found = {}
    for name, counts in meshes.items():
        count = counts[1 if quick else 0]
        if count:
            body = graded(name) if name in KINDS else stored(name)
            turns = fresh_turns(body, count, seed)
            found[name] = [ceiling(body, turn, starts=1 if quick else starts) for turn in turns]
    return found


def fresh_turns(body: Body, count: int, seed: int) -> Iterator[Turn]:
    """Random shifts and turns that the standard motion leaves below the threshold 0.2."""
    rng, d = np.random.default_rng(seed), body.points.shape[1]
    reach, found = (0.3 if d == 2 else 0.2), 0
    while found < count:
        axis = (0.0, 0.0, 1.0) if d == 2 else tuple(rng.normal(size=3))
        turn = Turn(tuple(rng.uniform(-reach, reach, size=(d,))), float(rng.uniform(-90.0, 90.0)), axis=axis)
        if body.judge().quality(_standard(body, turn)).min() < 0.2:
            found += 1
            yield turn


def ceiling(body: Body, turn: Turn, *, starts: int) -> Ceiling:
    """The result of the default correction for a motion, and the best result from the given number of starts."""
    mesh = body.judge()
    region = mesh.free(~body.held)
    ends, best = {}, correct(body.moved(_displacement(body, turn)), _METHOD).points
    reached = float(mesh.quality(best).min())
    highest = reached
    with one_blas_thread():
        for (name, points), _ in zip(_starts(body, turn), range(starts), strict=False):
            end, ends[name] = _descended(points, mesh, region)
            if ends[name] > highest:
                best, highest = end, ends[name]
        climbed_to = climbed(best, region, mesh.metric)
    standard = round(float(mesh.quality(_standard(body, turn)).min()), 6)  # −0 where corners are inverted without skew
    return Ceiling(standard, reached, ends, climbed_to)


def _displacement(body: Body, turn: Turn) -> Floats:
    """Displacement (n, d) of the body's nodes."""
    displacement = np.zeros_like(body.points)
    displacement[body.body] = turn(body.points[body.body]) - body.points[body.body]
    return displacement


def _standard(body: Body, turn: Turn, radius: float | None = None) -> Floats:
    """Positions (n, d) of the standard motion, with the given support radius or that of the mesh."""
    displacement = _displacement(body, turn)
    if radius is None:
        return body.moved(displacement).standard
    return _interpolated(body.points, displacement[body.held], body, radius)


def _interpolated(points: Floats, prescribed: Floats, body: Body, radius: float) -> Floats:
    """Points (n, d) moved by the interpolation of the given displacements of the held nodes (h, d)."""
    interpolant = factorize(points[body.held], support_radius=radius).solve(prescribed)
    moved = points + evaluation.displacement(interpolant, points)
    moved[body.held] = points[body.held] + prescribed
    return moved


def _starts(body: Body, turn: Turn) -> Iterator[tuple[str, Floats]]:
    """Start positions (n, d) of the descent; the first few differ most."""
    standard = _standard(body, turn)
    yield "standard motion", standard
    yield "four corrected sub-steps", _along_the_way(body, turn, 4)
    yield "nodes shaken", _shaken(body, standard)
    yield "support radius 2.5", _standard(body, turn, 2.5)


def _along_the_way(body: Body, turn: Turn, steps: int) -> Floats:
    """Relative sub-steps, each but the last corrected."""
    points, middle = body.points, tuple((body.points[body.body].min(axis=0) + body.points[body.body].max(axis=0)) / 2)
    for step in range(1, steps + 1):
        share = step / steps
        part = Turn(tuple(share * s for s in turn.shift), share * turn.degrees, middle, turn.axis)
        goal = body.points + _displacement(body, part)
        problem = replace(
            body.moved(np.zeros_like(points)),
            standard=_interpolated(points, (goal - points)[body.held], body, 0.5),
            reference=body.points,
        )
        points = problem.standard if step == steps else correct(problem, _METHOD).points
    return points


def _shaken(body: Body, points: Floats) -> Floats:
    """Free nodes moved at random, by a share of the shortest edge of their reference mesh."""
    free = ~body.held
    shaken = points.copy()
    size = _SHAKE * shortest(body.sizes, points.shape[1])
    shaken[free] += size * np.random.default_rng(0).normal(size=shaken[free].shape)
    return shaken


def _descended(points: Floats, mesh: TrialMesh, region: FreeRegion) -> tuple[Floats, float]:
    """The end (n, d) of the long descent, and the best minimum on the way."""
    d = points.shape[1]
    local = untangle(points[region.nodes], region, mesh.metric)
    best, highest = local, float(region_quality(local, region, mesh.metric).min())
    for norm in LONG if highest > 0.0 else ():
        local = newton(local, region, norm, iterations=_ITERATIONS, accuracy=_ACCURACY[d]).points
        minimum = float(region_quality(local, region, mesh.metric).min())
        if minimum > highest:
            best, highest = local, minimum
    end = points.copy()
    end[region.free] = best[: region.n_free]
    return end, highest


def shares_table(found: dict[str, list[Ceiling]], caption: str) -> Table:
    """Means over the motions of each mesh, and of all."""
    columns = ("mesh", "motions", "standard", "reached", "best known", "share", "worst share", "starts that agree")
    every = [c for ceilings in found.values() for c in ceilings]
    rows = [_row(name, ceilings) for name, ceilings in (*found.items(), ("all", every))]
    return Table(columns, rows, caption, digits=3)


def _row(name: str, found: list[Ceiling]) -> list[Cell]:
    """A line of the table; starts "agree" if they end within a thousandth of the best one."""
    agree = [end > 0.999 * max(c.ends.values()) for c in found for end in c.ends.values()]
    means = [
        round(float(np.mean([getattr(c, key) for c in found])), 6) + 0.0
        for key in ("standard", "reached", "best", "share")
    ]
    return [name, len(found), *means, min(c.share for c in found), f"{sum(agree)} of {len(agree)}"]


def draw_shares(figure: Any, found: dict[str, list[Ceiling]]) -> None:
    """Minimum size-skew of each motion, by mesh, in the order of the best known."""
    panels = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
    for ax, (name, ceilings) in zip(panels, found.items(), strict=True):
        ordered = sorted(ceilings, key=lambda c: c.best)
        place = np.arange(1, len(ordered) + 1)
        ax.plot(place, [c.best for c in ordered], "k_", ms=9, label="best known")
        ax.plot(place, [c.reached for c in ordered], "C0.", label="reached")
        ax.plot(place, [max(c.standard, 0.0) for c in ordered], "C3x", ms=4, label="standard (0: inverted)")
        ax.set(title=name, xlabel="motion", xticks=place)
    figure.axes[0].set_ylabel("minimum size-skew")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
