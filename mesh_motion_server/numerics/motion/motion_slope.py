"""The motion as a function of the moving nodes' positions, differentiated: J v, and Jᵀ w.

What can be differentiated is the motion that is a function of where the boundary is: the total displacement
interpolated from the reference mesh (``displacement = "absolute"``), plain or with the correction ``"smooth"``. Each
step of the motion is a linear map here, in the order of :meth:`.StandardMotion.trial`, and the transpose runs through
the same maps backwards. Vectors are (nodes, d) arrays: velocities forwards, weights of positions backwards.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import ClassVar, NoReturn

import numpy as np

from mesh_motion_server.errors import InvalidInput, NumericalError
from mesh_motion_server.numerics.arrays import Floats, Integers
from mesh_motion_server.numerics.correction.smooth_motion import SmoothMotion
from mesh_motion_server.numerics.correction.smooth_slope import SmoothSlope, not_at_minimum
from mesh_motion_server.numerics.decomposition import nearest_rotation_slope
from mesh_motion_server.numerics.interpolation.factor_source import FactorSource
from mesh_motion_server.numerics.interpolation.interpolation_map import InterpolationMap, interpolation_map
from mesh_motion_server.numerics.mesh.surface_constraints import OnFacets
from mesh_motion_server.numerics.motion.boundary_layer_slope import carried_slope
from mesh_motion_server.numerics.motion.prepared_mesh import PreparedMesh
from mesh_motion_server.numerics.motion.smooth_step import LatestPlain
from mesh_motion_server.numerics.motion.standard_motion import StandardMotion
from mesh_motion_server.numerics.stopwatch import Stopwatch

__all__ = ["DifferentiableMesh", "MotionSlope", "WithoutSlope", "motion_slope", "why_no_slope"]


#: Of the extent: nodes as close are at the same place.
_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class MotionSlope:
    """The derivative J of all nodes' positions by those of the moving nodes, at one mesh.

    Attributes
    ----------
    plain : PlainSlope
    smooth : SmoothSlope or None
        Of the correction; None without one.
    """

    plain: PlainSlope
    smooth: SmoothSlope | None

    def tangent(self, velocity: Floats) -> Floats:
        """(n, d) J v: velocities of all nodes, for those (k, d) of the moving nodes in their order."""
        plain = self.plain.apply(velocity)
        return plain if self.smooth is None else self.smooth.apply(plain)

    def cotangent(self, weights: Floats) -> Floats:
        """(k, d) Jᵀ w: the derivative of Σ w · y by the moving nodes' positions, for (n, d) weights w of all nodes."""
        return self.plain.transpose(weights if self.smooth is None else self.smooth.transpose(weights))


@dataclass(frozen=True, eq=False)
class DifferentiableMesh(PreparedMesh):
    """A prepared mesh, and the derivative of its motion.

    ``_latest``: the latest plain motions, which the next step and a derivative begin with.
    """

    _latest: LatestPlain = field(default_factory=LatestPlain)

    def why_no_slope(self) -> InvalidInput | None:
        """What keeps the motion from having a derivative; None if it has one."""
        return why_no_slope(self.carrying_layers)

    def slope(self, points: Floats, factors: FactorSource) -> MotionSlope:
        """The derivative of the motion that has led to ``points`` (n, d).

        Raises
        ------
        InvalidInput
            If it has none.
        NumericalError
            If the mesh was corrected in another way.
        """
        refusal = self.why_no_slope()
        if refusal is not None:
            raise refusal
        targets, layered = points[self.roles.moving], self.carrying_layers
        if self.winding is not None and self.winding.turns(points, targets) is not None:
            raise NumericalError(
                "a body has turned by more than a quarter turn: the motion that winds the mesh is not differentiated",
                code="FAILED_PRECONDITION",
                hint="ask at a smaller turn",
            )

        def plain_of(motion: StandardMotion) -> Floats:
            return motion.trial(self.points, targets, factors, Stopwatch()).points

        if self.method.correction == "smooth" and self.smooth is not None:
            plain = self._latest.at(targets, lambda: plain_of(layered))
            return motion_slope(layered, self.smooth, plain, points, factors)
        for motion in dict.fromkeys((layered, self.standard_motion)):  # whether layers were carried, the mesh says
            plain = plain_of(motion)
            if np.abs(plain - points).max() <= _SAME * np.ptp(self.points, axis=0).max():
                return motion_slope(motion, None, plain, points, factors)
        raise not_at_minimum()


class WithoutSlope:
    """A model of a motion that is not differentiated; ``no_slope`` says why, and the way out."""

    no_slope: ClassVar[tuple[str, str]]

    def why_no_slope(self) -> InvalidInput:
        """What keeps the motion from having a derivative."""
        return _no_slope(*self.no_slope)

    def slope(self, points: Floats, factors: FactorSource) -> NoReturn:
        """Refuse.

        Raises
        ------
        InvalidInput
        """
        del points, factors
        raise self.why_no_slope()


def why_no_slope(motion: StandardMotion) -> InvalidInput | None:
    """What of a method or a mesh keeps its motion from having a derivative; None if it has one."""
    method = motion.method
    named = {"displacement": ("absolute",), "correction": ("none", "smooth"), "reduction": ("none",)}
    for key, allowed in named.items():
        value = getattr(method, key)
        if value not in allowed:
            return _no_slope(
                f"{key} = {value!r}: the motion is no differentiable function of the boundary",
                f"open the session with {key} {' or '.join(map(repr, allowed))}",
                setting=key,
            )
    sliding = motion.sliding
    if sliding is not None and any(isinstance(surface, OnFacets) for _, surface in sliding.groups):
        return _no_slope("a slip wall is curved: the motion along it is not differentiated", "give it the role fixed")
    if (sliding is not None or motion.periodic is not None) and not len(motion.roles.fixed):
        return _no_slope(
            f"no node is fixed, and some {'slide' if sliding is not None else 'are periodic'}: "
            "the motion is not differentiated",
            "give a patch the role fixed",
        )
    return None


def motion_slope(
    motion: StandardMotion, smooth: SmoothMotion | None, plain: Floats, points: Floats, factors: FactorSource
) -> MotionSlope:
    """The derivative at a mesh.

    Parameters
    ----------
    smooth : SmoothMotion or None
        The correction that followed.
    plain, points : (n, d) arrays, mesh length unit
        Where the motion alone, and with its correction, has led.

    Raises
    ------
    NumericalError
        If the mesh was corrected in another way.
    """
    targets = points[motion.roles.moving]
    _refuse_held_order(motion, targets, plain, factors)
    slope = PlainSlope.build(motion, targets, factors)
    return MotionSlope(slope, None if smooth is None else SmoothSlope.build(smooth, plain, points))


def _refuse_held_order(motion: StandardMotion, targets: Floats, plain: Floats, factors: FactorSource) -> None:
    """Raise if nodes slide less than they would, so that none passes the end of its wall: there is a kink."""
    if motion.sliding is None or not motion.sliding.lines:
        return
    loose = replace(motion, sliding=replace(motion.sliding, lines=()))
    passing = np.abs(loose.trial(motion.reference, targets, factors, Stopwatch()).points - plain).max(axis=1) > 0.0
    if passing.any():
        raise NumericalError(
            f"node {int(np.argmax(passing))} slides no further, so that it keeps its order along its wall: "
            "the motion has no derivative here",
            code="FAILED_PRECONDITION",
            hint="ask at a smaller displacement, or give the wall the role fixed",
        )


def _no_slope(message: str, hint: str, **details: object) -> InvalidInput:
    return InvalidInput(message, code="FAILED_PRECONDITION", hint=hint, details=details)


@dataclass(frozen=True, eq=False)
class _Linear:
    """A change of all nodes' displacements (n, d) in place, and its transpose."""

    apply: Callable[[Floats], None]
    transpose: Callable[[Floats], None]


@dataclass(frozen=True, eq=False)
class PlainSlope:
    """The derivative of the standard motion.

    ``steps`` set rows of all nodes' velocities from the rows before; the last interpolation leads to all nodes, and
    ``tied`` places periodic images by their roots.
    """

    motion: StandardMotion
    steps: tuple[_Linear, ...]
    interpolated: _Interpolated
    known: Integers
    tied: _Linear

    @classmethod
    def build(cls, motion: StandardMotion, targets: Floats, factors: FactorSource) -> PlainSlope:
        """That at the moving nodes' positions ``targets`` (k, d)."""
        roles, layer, rest = motion.roles, motion.layer, motion.reference
        prescribed = rest.copy()
        prescribed[roles.moving] = targets
        steps, known = [], roles.all
        if layer is not None:
            steps.append(_of_layer(motion, prescribed))
            prescribed[layer.nodes] = layer.carried(prescribed)
            known = np.union1d(known, np.flatnonzero(layer.known))
        steps += _of_walls(motion, factors)
        controls = motion.control_nodes(roles.all)
        outer = _Interpolated.build(motion, controls, prescribed, rest, factors)
        return cls(motion, tuple(steps), outer, known, _of_images(motion))

    def apply(self, velocity: Floats) -> Floats:
        """(n, d) velocities of all nodes for (k, d) of the moving ones."""
        rows = np.zeros_like(self.motion.reference)
        rows[self.motion.roles.moving] = velocity
        for step in self.steps:
            step.apply(rows)
        out = self.interpolated.apply(rows)
        out[self.known] = rows[self.known]
        self.tied.apply(out)
        return out

    def transpose(self, weights: Floats) -> Floats:
        """(k, d) weights of the moving nodes for (n, d) of all."""
        free, rows = weights.copy(), np.zeros_like(weights)
        self.tied.transpose(free)
        rows[self.known] = free[self.known]
        free[self.known] = 0.0
        rows += self.interpolated.transpose(free)
        for step in reversed(self.steps):
            step.transpose(rows)
        return rows[self.motion.roles.moving]


@dataclass(frozen=True, eq=False)
class _Interpolated:
    """The interpolation from control nodes (c,) to places (p, d): without fixed nodes around the best rigid motion."""

    controls: Integers
    size: int
    map: InterpolationMap
    rigid: _RigidSlope | None

    @classmethod
    def build(
        cls, motion: StandardMotion, controls: Integers, goal: Floats, places: Floats, factors: FactorSource
    ) -> _Interpolated:
        """That of a motion of its control nodes from the reference mesh to ``goal`` (n, d)."""
        origin = motion.reference.take(controls, axis=0)
        made = interpolation_map(motion.factorized(controls, factors), places)
        rigid = None if len(motion.roles.fixed) else _RigidSlope(origin, goal[controls], places)
        return cls(controls, len(motion.reference), made, rigid)

    def apply(self, rows: Floats) -> Floats:
        values = rows[self.controls]
        if self.rigid is None:
            return self.map.apply(values)
        carried, places = self.rigid.apply(values)
        return places + self.map.apply(values - carried)

    def transpose(self, weights: Floats) -> Floats:
        """(n, d) what the control nodes' rows count for (p, d) weights of the places."""
        out = np.zeros((self.size, weights.shape[1]))
        values = self.map.transpose(weights)
        out[self.controls] = values if self.rigid is None else values + self.rigid.transpose(-values, weights)
        return out


class _RigidSlope:
    """The derivative of the best rigid motion of control nodes, which carries them and other places."""

    def __init__(self, origin: Floats, goal: Floats, places: Floats) -> None:
        centre = origin.mean(axis=0)
        self._arms, self._far = origin - centre, places - centre
        spread = np.einsum("ki,kj->ij", goal - goal.mean(axis=0), self._arms)
        self._slope = nearest_rotation_slope(spread[None])[0]

    def apply(self, values: Floats) -> tuple[Floats, Floats]:
        """Velocities of the carried control nodes (c, d) and places (p, d) for (c, d) of the control nodes."""
        shift = values.mean(axis=0)
        turn = np.einsum("abce,kc,ke->ab", self._slope, values, self._arms)
        return shift + self._arms @ turn.T, shift + self._far @ turn.T

    def transpose(self, carried: Floats, places: Floats) -> Floats:
        """(c, d) weights of the control nodes for (c, d) of the carried ones and (p, d) of the places."""
        shift = carried.sum(axis=0) + places.sum(axis=0)
        turn = carried.T @ self._arms + places.T @ self._far
        return np.asarray(shift / len(self._arms) + self._arms @ np.einsum("abce,ab->ec", self._slope, turn))


def _of_layer(motion: StandardMotion, prescribed: Floats) -> _Linear:
    """A layer's nodes follow their wall."""
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


def _of_walls(motion: StandardMotion, factors: FactorSource) -> list[_Linear]:
    """The nodes of plane walls follow, projected onto them."""
    steps, rest, layer = [], motion.reference, motion.layer
    for followed, wall in motion.walls():
        own = np.ones(len(wall.nodes), dtype=bool) if layer is None else ~layer.known[wall.nodes]
        nodes, tangents = wall.nodes[own], wall.tangents(rest[wall.nodes])[own]
        following = None
        if wall.freedom().any():
            controls = motion.control_nodes(followed)
            following = _Interpolated.build(motion, controls, rest, rest[nodes], factors)
        steps += [_of_wall(nodes, tangents, following), _of_images(motion)]
    return steps


def _nothing(_rows: Floats) -> None:
    """No node moves as another one."""


def _of_images(motion: StandardMotion) -> _Linear:
    """Periodic images move as their roots; moving nodes go to their targets."""
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


def _of_wall(nodes: Integers, tangents: Floats, following: _Interpolated | None) -> _Linear:
    """The nodes of one wall, which follow, or stay."""

    def apply(rows: Floats) -> None:
        rows[nodes] = 0.0 if following is None else np.einsum("mij,mj->mi", tangents, following.apply(rows))

    def transpose(rows: Floats) -> None:
        weights = np.einsum("mij,mi->mj", tangents, rows[nodes])
        rows[nodes] = 0.0
        if following is not None:
            rows += following.transpose(weights)

    return _Linear(apply, transpose)
