"""A step of the motion that is a smooth function of the boundary: in one step if possible, otherwise along a way.

The result depends on where the boundary is, not on the way (:mod:`~.correction.smooth_motion`). The way only gives the
start of Newton's iterations: the committed mesh, carried along with the plain motion. A large step is divided into
parts, and each part is corrected before the next.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np
from mesh_motion_protocol.errors import QualityRefused

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.correction.correction import Correction
from mesh_motion_numerics.correction.smooth_motion import Smoothed, SmoothMotion

if TYPE_CHECKING:
    from mesh_motion_numerics.motion.standard_motion import StandardMotion

NOT_SMOOTH = (
    "no mesh was found that is a smooth function of the boundary: this step is corrected by itself, and nodes may jump"
)
"""The warning of a step for which no smooth motion was found."""

_MOST_KEPT = 100_000  # largest mesh, in nodes, whose plain motions are kept
_SHORTEST = 1 / 64  # smallest part of a way
_MOST_ITERATIONS = 300  # largest number of iterations of a step that is led along a way


@dataclass(frozen=True, eq=False)
class Followed:
    """The progress on a way: the last corrected mesh, its fraction, the number of parts and of iterations."""

    found: Smoothed
    fraction: float
    legs: int
    iterations: int

    def correction(self) -> Correction:
        """The correction's result; with a warning if the mesh is not at the minimum."""
        found = self.found
        return Correction(
            found.points,
            found.points[:0],
            freed_nodes=found.freed,
            iterations=self.iterations,
            method="smooth" if found.freed else "none",
            warnings=() if found.converged else (unconverged(found),),
        )


@dataclass(eq=False)
class LatestPlain:
    """The latest plain motions of a mesh: a step begins at the end of another one.

    Three are kept, the latest last: of a step's first boundary, of the trial before, and of the trial. For a large mesh
    none is kept: its correction takes many times as long, and they would take a tenth of its memory. For the same
    number of meshes without a correction, the motion that led to them is kept.
    """

    kept: dict[bytes, Floats] = field(default_factory=dict)
    uncorrected: tuple[tuple[weakref.ref[Floats], StandardMotion], ...] = ()

    def at(self, targets: Floats, make: Callable[[], Floats]) -> Floats:
        """That (n, d) to the moving nodes' ``targets`` (k, d), made if it is not kept."""
        kept = self.kept.get(targets.tobytes())
        plain = make() if kept is None else kept
        self.keep(targets, plain)
        return plain

    def keep(self, targets: Floats, plain: Floats) -> None:
        """Keep the ``plain`` motion (n, d) to the moving nodes' ``targets`` (k, d)."""
        if len(plain) <= _MOST_KEPT:
            self.kept.pop(targets.tobytes(), None)
            self.kept = dict([*self.kept.items()][-2:]) | {targets.tobytes(): plain}

    def led_to(self, points: Floats, motion: StandardMotion) -> None:
        """Remember that a motion alone has led to the mesh ``points`` (n, d), as long as this array exists."""
        self.uncorrected = (*self.uncorrected[-2:], (weakref.ref(points), motion))

    def that_led_to(self, points: Floats) -> StandardMotion | None:
        """The motion that alone has led to this array ``points`` (n, d), if it is known."""
        return next((motion for mesh, motion in self.uncorrected if mesh() is points), None)


def smooth_step(
    correction: SmoothMotion,
    committed: Floats,
    plain_before: Callable[[], Floats],
    plain: Floats,
    ways: Callable[[], Iterable[PlainWay]],
    carried: Carried | None = None,
    distorted: Integers | None = None,
    along: Callable[[float], SmoothMotion] | None = None,
) -> Followed:
    """The corrected mesh for the ``plain`` motion (n, d).

    Raises QualityRefused if no way leads to a valid mesh; the message says how far the mesh stayed valid.

    Parameters
    ----------
    committed, plain : (n, d) arrays, mesh length unit
    plain_before : callable
        Makes the plain motion (n, d) to the committed mesh's boundary, if it is needed.
    ways : callable
        Makes, if they are needed, the ways that are tried in turn where one step fails: each a callable, fraction → the
        plain motion (n, d), from there to ``plain``.
    carried : callable, optional
        Carries a mesh along a part of the way; by default with the plain motion.
    distorted : (k,) int64 array, optional
        As in :meth:`.SmoothMotion.correct`.
    along : callable, optional
        Gives the correction at a fraction of a way, equal to ``correction`` at its end: tried where ``correction``
        fails along all ways.
    """
    carried = carried or _with_plain
    at_once = correction.correct(plain, [lambda: carried(committed, plain_before(), plain, 0.0, 1.0)], distorted)
    if at_once.converged:
        return Followed(at_once, 1.0, 1, at_once.iterations)
    furthest, left, before = 0.0, _MOST_ITERATIONS, plain_before()
    for corrections in [lambda _fraction: correction, *([along] if along else [])]:
        for way in ways():
            followed = follow(corrections, committed, before, way, left, carried)
            if followed.fraction == 1.0:
                return followed
            furthest, left = max(furthest, followed.fraction), left - followed.iterations
    if np.isfinite(at_once.residual):
        return Followed(at_once, 1.0, 1, at_once.iterations)
    raise QualityRefused(f"no valid mesh found: in sub-steps the mesh was kept valid for {furthest:.3g} of the way")


PlainWay = Callable[[float], Floats]
Carried = Callable[[Floats, Floats, Floats, float, float], Floats]
"""A mesh, its plain motion, the one to reach, and both fractions of the way → a mesh near the result (n, d)."""


def follow(
    corrections: Callable[[float], SmoothMotion],
    committed: Floats,
    plain_before: Floats,
    way: PlainWay,
    most: int,
    carried: Carried,
) -> Followed:
    """Lead the committed mesh along a way, in about ``most`` iterations at most.

    A part is halved if the iterations cannot begin or take too long. From then on each part but the last one ends near
    the minimum, and each begins where the carried mesh and the way that it went in the part before lead.
    """
    fraction, length, points, before = 0.0, 0.5, committed, plain_before
    found, legs, iterations, left = Smoothed(committed), 0, 0, np.zeros_like(committed)
    while fraction < 1.0 and length >= _SHORTEST and iterations < most:
        length = min(length, 1.0 - fraction)  # exact, because they are sums of powers of two
        plain, halved = way(fraction + length), length < 0.5
        near = cache(partial(carried, points, before, plain, fraction, fraction + length))
        ahead = partial(_ahead, near, length * left)
        starts: list[Callable[[], Floats]] = [ahead, near] if halved and legs else [near]
        leg = corrections(fraction + length).correct(plain, starts, rough=halved and fraction + length < 1.0)
        iterations += leg.iterations
        if leg.converged:
            left = (leg.points - near()) / length
            found, fraction, points, before, legs = leg, fraction + length, leg.points, plain, legs + 1
            length *= 2.0
        else:
            length *= 0.5
    return Followed(found, fraction, legs, iterations)


def _ahead(near: Callable[[], Floats], shift: Floats) -> Floats:
    return near() + shift


def _with_plain(points: Floats, before: Floats, plain: Floats, _begin: float, _end: float) -> Floats:
    return points + (plain - before)


def unconverged(found: Smoothed) -> str:
    """The warning about a mesh that is not at the minimum."""
    return (
        f"the correction stopped before its minimum: its last step was {found.residual:.3g} long, so the mesh depends "
        "on the path by about this length"
    )
