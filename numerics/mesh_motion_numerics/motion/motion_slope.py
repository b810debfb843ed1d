"""The motion as a function of the moving nodes' positions, differentiated: J v, and Jᵀ w.

A motion can be differentiated if it is a function of the boundary's position: the total displacement interpolated from
the reference mesh (``displacement = "absolute"``), without a correction or with ``"smooth"``. Each step of the motion
is a linear map here, in the order of :meth:`.StandardMotion.trial`, and the transpose runs through the same maps
backwards. Vectors are (nodes, d) arrays: velocities forwards, weights of positions backwards.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np
from mesh_motion_protocol.errors import InvalidInput, QualityRefused

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.correction.smooth_motion import SmoothMotion
from mesh_motion_numerics.correction.smooth_slope import SAME, SmoothSlope, not_at_minimum
from mesh_motion_numerics.interpolation.factor_source import FactorSource
from mesh_motion_numerics.interpolation.interpolation_map import InterpolationMap, interpolation_map
from mesh_motion_numerics.mesh.points import bounding_box
from mesh_motion_numerics.motion.boundary_layer_slope import carried_slope
from mesh_motion_numerics.motion.prepared_mesh import PreparedMesh
from mesh_motion_numerics.motion.rigid_slope import RigidSlope, rigid_slope
from mesh_motion_numerics.motion.smooth_step import LatestPlain
from mesh_motion_numerics.motion.standard_motion import StandardMotion
from mesh_motion_numerics.motion.winding import Turns
from mesh_motion_numerics.motion.winding_slope import WindingSlope
from mesh_motion_numerics.stopwatch import Stopwatch


@dataclass(frozen=True, eq=False)
class MotionSlope:
    """The derivative J of all nodes' positions by those of the moving nodes, at one mesh."""

    plain: PlainSlope
    smooth: SmoothSlope | None  # Derivative of the correction; None without one
    #: Derivative of the winding of the plain motion; None if no body has turned by more than a quarter turn.
    winding: WindingSlope | None = None

    def tangent(self, velocity: Floats) -> Floats:
        """(n, d) J v: velocities of all nodes for velocities (k, d) of the moving nodes, in their order."""
        winding, later = self.winding, 0.0
        if winding is None:
            plain = self.plain.apply(velocity)
        else:
            plain, later = winding.wound(self.plain.apply(winding.back(velocity)), velocity), winding.later(velocity)
        return plain if self.smooth is None else self.smooth.apply(plain, later)

    def cotangent(self, weights: Floats) -> Floats:
        """(k, d) Jᵀ w: the derivative of Σ w · y by the moving nodes' positions, for (n, d) weights w of all nodes."""
        plain, later = (weights, 0.0) if self.smooth is None else self.smooth.transpose(weights)
        if self.winding is None:
            return self.plain.transpose(plain)
        plain, moving = self.winding.unwound(plain, later)
        return moving + self.winding.back_transposed(self.plain.transpose(plain))


@dataclass(frozen=True, eq=False)
class DifferentiableMesh(PreparedMesh):
    """A prepared mesh, and the derivative of its motion.

    ``_latest``: the latest plain motions, with which the next step and a derivative begin.
    """

    _latest: LatestPlain = field(default_factory=LatestPlain)

    def why_no_slope(self) -> InvalidInput | None:
        """The reason why the motion has no derivative; None if it has one."""
        return why_no_slope(self.carrying_layers)

    def slope(self, points: Floats, factors: FactorSource) -> MotionSlope:
        """The derivative of the motion that has led to ``points`` (n, d).

        Raises InvalidInput if the motion has no derivative. Raises QualityRefused if the mesh was corrected by another
        correction.
        """
        refusal = self.why_no_slope()
        if refusal is not None:
            raise refusal
        targets, layered = points[self.roles.moving], self.carrying_layers
        turns = None if self.winding is None else self.winding.turns(points, targets)
        if turns is not None:
            return self._wound_slope(points, turns, factors)

        def plain_of(motion: StandardMotion) -> Floats:
            return motion.trial(self.points, targets, factors, Stopwatch()).points

        candidates = list(dict.fromkeys((layered, self.standard_motion)))
        known = self._latest.that_led_to(points)
        for motion in candidates:
            if known is not None and known.sliding is None and known.layer is motion.layer:
                return motion_slope(motion, None, points, points, factors)
        if self.method.correction == "smooth" and self.smooth is not None:
            plain = self._latest.at(targets, lambda: plain_of(layered))
            return motion_slope(layered, self.smooth, plain, points, factors)
        candidates += [replace(one, sliding=one.sliding.held()) for one in candidates if one.sliding is not None]
        for motion in candidates:  # the mesh shows whether layers were carried and nodes slid
            plain = plain_of(motion)
            if np.abs(plain - points).max() <= SAME * np.ptp(bounding_box(self.points), axis=0).max():
                return motion_slope(motion, None, plain, points, factors)
        raise not_at_minimum()

    def _wound_slope(self, points: Floats, turns: Turns, factors: FactorSource) -> MotionSlope:
        """The derivative at ``points`` (n, d) that bodies may have wound; uncertain turns are the smallest ones."""
        winding, motion, targets = self.winding, self.carrying_layers, points[self.roles.moving]
        assert winding is not None
        assert self.smooth is not None
        for meant in (turns if turns.certain else None, turns.unwound):
            if meant is None:
                continue
            back, wind = winding.winds(targets, meant, 1.0)
            plain = motion.trial(self.points, back, factors, Stopwatch()).points
            smooth, wound = copy(self.smooth.later(winding.sheared(meant))), wind(plain)
            with suppress(QualityRefused):  # the other turns may have led to these points
                found = SmoothSlope.build(smooth, wound, points)
                slope = WindingSlope.build(winding, meant, targets, plain)
                return MotionSlope(plain_slope(motion, plain, factors), found, slope)
        raise not_at_minimum()


def why_no_slope(motion: StandardMotion) -> InvalidInput | None:
    """The reason in a method or a mesh why its motion has no derivative; None if it has one."""
    method = motion.method
    named = {"displacement": ("absolute",), "correction": ("none", "smooth"), "reduction": ("none",)}
    wrong = {key: allowed for key, allowed in named.items() if getattr(method, key) not in allowed}
    if not wrong:
        return None
    first = next(iter(wrong))
    ways_out = (f"{key} {' or '.join(map(repr, allowed))}" for key, allowed in wrong.items())
    return InvalidInput(
        f"{first} = {getattr(method, first)!r}: the motion is no differentiable function of the boundary",
        code="FAILED_PRECONDITION",
        hint=f"open the session with {' and '.join(ways_out)}",
        details={"setting": first},
    )


def motion_slope(
    motion: StandardMotion, smooth: SmoothMotion | None, plain: Floats, points: Floats, factors: FactorSource
) -> MotionSlope:
    """Return the derivative at a mesh.

    Raises QualityRefused if the mesh was corrected by another correction.

    Parameters
    ----------
    smooth : SmoothMotion or None
        The correction that followed.
    plain, points : (n, d) arrays, mesh length unit
        Results of the motion alone, and with its correction.
    """
    slope = plain_slope(motion, plain, factors)
    return MotionSlope(slope, None if smooth is None else SmoothSlope.build(smooth, plain, points))


def plain_slope(motion: StandardMotion, plain: Floats, factors: FactorSource) -> PlainSlope:
    """Return the derivative of a motion without correction that has led to ``plain`` (n, d).

    Raises QualityRefused if there is no derivative at these points.
    """
    _refuse_held_order(motion, plain[motion.roles.moving], plain, factors)
    return PlainSlope.build(motion, plain, factors)


def _refuse_held_order(motion: StandardMotion, targets: Floats, plain: Floats, factors: FactorSource) -> None:
    """Raise if nodes are stopped from passing the end of their wall: the motion has a kink there."""
    if motion.sliding is None or not motion.sliding.lines:
        return
    lines = tuple(replace(line, keeps_order=False) for line in motion.sliding.lines)
    loose = replace(motion, sliding=replace(motion.sliding, lines=lines))
    passing = np.abs(loose.trial(motion.reference, targets, factors, Stopwatch()).points - plain).max(axis=1) > 0.0
    if passing.any():
        raise QualityRefused(
            f"node {int(np.argmax(passing))} slides no further, so that it keeps its order along its wall: "
            "the motion has no derivative here",
            code="FAILED_PRECONDITION",
            hint="request it at a smaller displacement, or give the wall the role fixed",
        )


@dataclass(frozen=True, eq=False)
class _Linear:
    """A change of all nodes' displacements (n, d) in place, and its transpose."""

    apply: Callable[[Floats], None]
    transpose: Callable[[Floats], None]


@dataclass(frozen=True, eq=False)
class PlainSlope:
    """The derivative of the standard motion.

    ``steps`` set rows of all nodes' velocities from earlier rows; the last interpolation gives all nodes, and ``tied``
    places periodic images by their roots.
    """

    motion: StandardMotion
    steps: tuple[_Linear, ...]
    interpolated: _Interpolated
    known: Integers
    tied: _Linear

    @classmethod
    def build(cls, motion: StandardMotion, plain: Floats, factors: FactorSource) -> PlainSlope:
        """Build the derivative of the motion that has led to ``plain`` (n, d)."""
        steps = [] if motion.layer is None else [_of_layer(motion, plain)]
        steps += _of_walls(motion, plain, factors)
        outer = _Interpolated.build(motion, motion.controls, plain, motion.reference, factors, motion.known)
        return cls(motion, tuple(steps), outer, motion.known, _of_images(motion))

    def apply(self, velocity: Floats) -> Floats:
        """(n, d) velocities of all nodes for velocities (k, d) of the moving nodes."""
        rows = np.zeros_like(self.motion.reference)
        rows[self.motion.roles.moving] = velocity
        for step in self.steps:
            step.apply(rows)
        out = self.interpolated.apply(rows)
        out[self.known] = rows[self.known]
        self.tied.apply(out)
        return out

    def transpose(self, weights: Floats) -> Floats:
        """(k, d) weights of the moving nodes for weights (n, d) of all nodes."""
        free, rows = weights.copy(), np.zeros_like(weights)
        self.tied.transpose(free)
        rows[self.known] = free[self.known]
        free[self.known] = 0.0
        self.interpolated.add_transposed(free, rows)
        for step in reversed(self.steps):
            step.transpose(rows)
        return rows[self.motion.roles.moving]


@dataclass(frozen=True, eq=False)
class _Interpolated:
    """The interpolation from control nodes (c,) to places (p, d), around the best rigid motion if no node is fixed."""

    controls: Integers
    map: InterpolationMap
    rigid: RigidSlope | None

    @classmethod
    def build(
        cls,
        motion: StandardMotion,
        controls: Integers,
        goal: Floats,
        places: Floats,
        factors: FactorSource,
        left_out: Integers | None = None,
    ) -> _Interpolated:
        """Build it for a motion of its control nodes from rest to ``goal`` (n, d), without the rows ``left_out``."""
        made = interpolation_map(motion.factorized(controls, factors), places, factors, left_out=left_out)
        rigid = None if len(motion.roles.fixed) else rigid_slope(motion, controls, goal, places)
        return cls(controls, made, rigid)

    def apply(self, rows: Floats) -> Floats:
        values = rows[self.controls]
        if self.rigid is None:
            return self.map.apply(values)
        carried, places = self.rigid.apply(values)
        return places + self.map.apply(values - carried)

    def add_transposed(self, weights: Floats, rows: Floats) -> None:
        """Add to all nodes' ``rows`` (n, d) the derivatives by the control nodes, for (p, d) weights of the places."""
        values = self.map.transpose(weights)
        rows[self.controls] += values if self.rigid is None else values + self.rigid.transpose(-values, weights)


@dataclass(frozen=True, eq=False)
class _Carried:
    """The rigid motion of control nodes (c,), which carries other places (p, d)."""

    controls: Integers
    rigid: RigidSlope

    def apply(self, rows: Floats) -> Floats:
        return self.rigid.apply(rows[self.controls])[1]

    def add_transposed(self, weights: Floats, rows: Floats) -> None:
        """As :meth:`_Interpolated.add_transposed`."""
        rows[self.controls] += self.rigid.transpose(np.zeros((len(self.controls), rows.shape[1])), weights)


def _of_layer(motion: StandardMotion, prescribed: Floats) -> _Linear:
    """The step in which a layer's nodes follow their wall."""
    layer = motion.layer
    assert layer is not None
    wall, nodes, d = layer.wall.nodes, layer.nodes, prescribed.shape[1]
    slope = carried_slope(layer, prescribed)

    def apply(rows: Floats) -> None:
        rows[nodes] = (slope @ rows[wall].ravel()).reshape(-1, d)

    def transpose(rows: Floats) -> None:
        weights = rows[nodes].ravel()
        rows[nodes] = 0.0
        rows[wall] += (slope.T @ weights).reshape(-1, d)

    return _Linear(apply, transpose)


def _of_walls(motion: StandardMotion, plain: Floats, factors: FactorSource) -> list[_Linear]:
    """The step in which the nodes of walls follow, projected onto the walls."""
    steps, rest, layer = [], motion.reference, motion.layer
    for followed, wall in motion.walls():
        own = wall if layer is None else wall.of(~layer.known[wall.nodes])
        places = rest[own.nodes]
        following: _Interpolated | _Carried | None = None
        controls = motion.control_nodes(followed)
        if wall.only_carried:
            slope, rigid = (
                rigid_slope(motion, controls, plain, places),
                motion.carry(rest, rest[controls], plain[controls]),
            )
            following = None if slope is None else _Carried(controls, slope)
            places = places if rigid is None else rigid.apply(places)
        elif wall.freedom().any():
            following = _Interpolated.build(motion, controls, plain, places, factors)
            if own.curved:
                places = motion.solved(rest, controls, plain[controls], factors, Stopwatch()).stage.positions(places)
        steps += [_of_wall(own.nodes, own.slope(places), following), _of_images(motion)]
        if own.curved and 1 in wall.freedom() and not wall.only_carried:
            now, known = plain.copy(), np.zeros(len(plain), dtype=bool) if layer is None else layer.known.copy()
            now[own.nodes], known[followed] = own.project(places), True
            steps += [_Linear(line.apply, line.transpose) for line in wall.evened_lines(rest, motion.tied(now), known)]
    return steps


def _nothing(_rows: Floats) -> None:
    """A step without effect: no node follows another one."""


def _of_images(motion: StandardMotion) -> _Linear:
    """The step in which periodic images move like their roots, and moving nodes go to their targets."""
    if motion.periodic is None:
        return _Linear(_nothing, _nothing)
    orbits = motion.periodic.of(~np.isin(motion.periodic.members, motion.roles.moving))
    members, roots, matrices = orbits.members, orbits.roots, orbits.matrices

    def apply(rows: Floats) -> None:
        rows[members] = np.einsum("pij,pj->pi", matrices, rows[roots])

    def transpose(rows: Floats) -> None:
        weights = np.einsum("pij,pi->pj", matrices, rows[members])
        rows[members] = 0.0
        np.add.at(rows, roots, weights)

    return _Linear(apply, transpose)


def _of_wall(nodes: Integers, onto: Floats, following: _Interpolated | _Carried | None) -> _Linear:
    """The nodes of one wall, which follow and are projected by ``onto`` (k, d, d), or are held."""

    def apply(rows: Floats) -> None:
        rows[nodes] = 0.0 if following is None else np.einsum("mij,mj->mi", onto, following.apply(rows))

    def transpose(rows: Floats) -> None:
        weights = np.einsum("mij,mi->mj", onto, rows[nodes])
        rows[nodes] = 0.0
        if following is not None:
            following.add_transposed(weights, rows)

    return _Linear(apply, transpose)
