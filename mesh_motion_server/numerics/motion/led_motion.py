"""A motion in sub-steps: the mesh is led to its targets along the bodies' ways, then corrected there.

The legs (:mod:`.sub_steps`) are motions of their own: each interpolates from the mesh of the one before and corrects
it up to the threshold, from wherever the method's displacement counts: the committed mesh, or the reference mesh. So
what comes out depends on that mesh and the targets only. At the end the method's own correction goes on from the valid
mesh that was found, as far as its target asks.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import NumericalError
from mesh_motion_server.numerics.interpolation.factor_source import FactorSource, MakeEachTime
from mesh_motion_server.numerics.mesh.boundary_crossing import BoundaryFacets, crossing_place
from mesh_motion_server.numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_server.numerics.mesh.boundary_orientation import overturned_place
from mesh_motion_server.numerics.motion.body_paths import Way, moving_bodies, straight_way, ways
from mesh_motion_server.numerics.motion.sub_steps import Leg, Walk, furthest_walk
from mesh_motion_server.numerics.stopwatch import Stopwatch

if TYPE_CHECKING:
    from mesh_motion_server.numerics.motion.motion import MotionModel
    from mesh_motion_server.numerics.motion.motion_found import Motion

__all__ = ["boundary_of", "led_motion", "refuse_crossing"]

Floats = NDArray[np.float64]


def led_motion(
    model: MotionModel,
    committed: Floats,
    targets: Floats,
    factors: FactorSource,
    *,
    direct: NumericalError | None = None,
) -> Motion:
    """The motion that takes the moving nodes to ``targets``, in sub-steps.

    Parameters
    ----------
    model : MotionModel
    committed : (n, d) array
        Committed positions, mesh length unit.
    targets : (k, d) array
        Where ``model.roles.moving`` shall be.
    factors : FactorSource
        Keeps the factorization at the start, which the coupling iterations of a step share.
    direct : NumericalError, optional
        Why one step was refused.

    Raises
    ------
    NumericalError
        When the boundary crosses itself at the targets, or no way leads there: says how far the mesh could be kept
        valid.
    """
    watch = Stopwatch()
    start = committed if model.method.displacement == "relative" else model.points
    boundary = boundary_of(model)
    with watch.phase("correct"):
        refuse_crossing(model, boundary, start, targets, direct)
        furthest = _led(model, boundary, start, targets, factors)
    refusal = direct or furthest.refusal
    if furthest.fraction < 1.0 and refusal is not None:
        raise NumericalError(
            f"{refusal.message}; in {furthest.legs} sub-steps the mesh was kept valid for "
            f"{furthest.fraction:.3g} of the way",
            best=refusal.best,
            cells=refusal.cells,
            details=refusal.details,
        )
    motion = model.attempt(committed, targets, factors, valid=furthest.points)
    correction = replace(motion.correction, iterations=furthest.iterations + motion.correction.iterations)
    led = watch.seconds()
    seconds = {**motion.seconds, "correct": led["correct"] + motion.seconds["correct"], "total": led["total"]}
    return replace(motion, sub_steps=furthest.legs, correction=correction, seconds=seconds)


def boundary_of(model: MotionModel) -> BoundaryFacets:
    """What may cross."""
    facets, roles = boundary_facets(model.cells), model.roles
    return BoundaryFacets.build(facets, roles.moving, roles.fixed, len(model.points))


def refuse_crossing(
    model: MotionModel,
    boundary: BoundaryFacets,
    points: Floats,
    told: Floats,
    direct: NumericalError | None = None,
) -> None:
    """Raise NumericalError where the boundary of the mesh ``points`` (n, d), told (k, d) to be so, crosses itself.

    Or where a closed part of it is turned inside out.
    """
    moved, is_told = points.copy(), np.zeros(len(points), dtype=bool)
    moved[model.roles.moving] = told
    is_told[model.roles.moving] = is_told[model.roles.fixed] = True
    place, fault = crossing_place(boundary, moved), "cross itself"
    if place is None:
        place, fault = overturned_place(boundary_facets(model.cells), is_told, model.points, moved), "turn inside out"
    if place is None:
        return
    near = ", ".join(f"{x:.4g}" for x in place)
    known = direct or NumericalError("")
    raise NumericalError(
        f"no valid mesh exists: the boundary would {fault} near ({near})",
        best=known.best,
        cells=known.cells,
        details=known.details,
    )


def _led(model: MotionModel, boundary: BoundaryFacets, start: Floats, targets: Floats, factors: FactorSource) -> Walk:
    """The mesh ``start`` (n, d) led along the first way on which it stays valid, or else as far as possible."""
    alike = model.with_method(
        displacement="relative",
        correction_target="threshold",
        correction_in_time="independent",
        refuse_below_threshold=False,
    )
    legs = replace(alike, other_radii=(), smooth=None)

    def move(points: Floats, waypoint: Floats) -> Leg:
        refuse_crossing(model, boundary, points, waypoint)
        found = legs.attempt(points, waypoint, factors if points is start else MakeEachTime())
        return Leg(found.points, found.standard.inverted == 0, found.correction.iterations)

    return furthest_walk(start, (way.at for way in _ways(model, start[model.roles.moving], targets)), move)


def _ways(model: MotionModel, origin: Floats, targets: Floats) -> Iterator[Way]:
    """Ways for the moving nodes (k, d); periodic ones have to go alike, which a scaled displacement does."""
    if model.standard_motion.periodic is not None:
        return iter([straight_way(origin, targets)])
    return ways(origin, targets, moving_bodies(model.cells, model.roles.moving))
