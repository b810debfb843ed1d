"""Standard RBF motion: the displacement of every node from that of the boundary (thesis (2.6)), without correction.

The method's key *displacement* says from which mesh the motion is interpolated, and how:

relative
    from the committed mesh, with the displacement since then. Drifts on periodic motion.
absolute
    from the reference mesh, with the total displacement. The result depends on the boundary alone: no drift.
reanchored
    from the reference mesh, through sub-steps along a path that rotates with the body; each sub-step interpolates from
    the mesh of the one before. The result also depends on the boundary alone, and larger rotations are possible than
    with ``absolute``.

The wall carries the nodes of its boundary layer (:mod:`.boundary_layer`), and the nodes outside follow the layer.

With a point reduction the interpolation starts from few of the boundary nodes and is corrected near the surface
(:mod:`.reduced_motion`); everything else stays the same.

When every prescribed node moves (no node is fixed), the best rigid motion is separated first and applied to all nodes
exactly: a mesh in rigid motion is not deformed at all. Slip walls must map onto themselves, as the hub and the tip of a
sector that turns about its axis do. A curved wall without an end, such as a circle, only follows this rigid
motion; it stays if there is none.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import mesh_motion_kernels as kernels
import numpy as np
from mesh_motion_protocol.errors import QualityRefused

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.evaluation import NearOperator
from mesh_motion_numerics.interpolation.factor_source import (
    DeferredFactorization,
    FactorSource,
    factorization_of,
    operators_of,
    two_scale_factorization_of,
)
from mesh_motion_numerics.interpolation.far_field import FarFieldFactorization
from mesh_motion_numerics.interpolation.interpolant import Factorization
from mesh_motion_numerics.interpolation.kernels import basis_named
from mesh_motion_numerics.interpolation.periodic_interpolant import periodic_factorization_of
from mesh_motion_numerics.interpolation.support_radius import Reach, with_reach
from mesh_motion_numerics.interpolation.two_scale.factorization import TwoScalePlan, plan_for, plans_for
from mesh_motion_numerics.interpolation.two_scale.interpolant import AnyInterpolant, TwoScaleInterpolant
from mesh_motion_numerics.interpolation.two_scale.smoothing import Smoothing
from mesh_motion_numerics.mesh.paths import RigidMotion, fit_rigid_motion, fit_screw, substeps
from mesh_motion_numerics.mesh.periodic_nodes import PeriodicNodes
from mesh_motion_numerics.mesh.points import bounding_box, marks_at
from mesh_motion_numerics.mesh.roles import BoundaryRoles, Patch
from mesh_motion_numerics.mesh.sliding import SlidingSurfaces
from mesh_motion_numerics.mesh.whole_walls import whole_walls
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.boundary_layer import BoundaryLayer
from mesh_motion_numerics.motion.method_check import check_method
from mesh_motion_numerics.reduction.reduced_motion import boundary_spacing, interpolate_reduced
from mesh_motion_numerics.stopwatch import Stopwatch

#: A re-anchored motion has one sub-step for each such share of the domain's extent that a boundary node moves …
_SUBSTEP_FRACTION = 0.025
#: … and at most this many.
_MAX_SUBSTEPS = 20


@dataclass(frozen=True, eq=False)
class Stage:
    """``x → rigid(x) + S(x)``."""

    rigid: RigidMotion | None  # None means the identity
    #: S, or its first level if few control points represent the boundary.
    interpolant: AnyInterpolant
    further: tuple[AnyInterpolant, ...] = ()  # The other levels of S; S is the sum of all levels

    def positions(self, points: Floats, prepared: Sequence[NearOperator] | None = None) -> Floats:
        """(n, d) new positions of points (n, d); ``prepared`` as in :func:`.evaluation.displacement`."""
        carried = points if self.rigid is None else self.rigid.apply(points)
        moved = evaluation.displacement(self.interpolant, points, prepared)
        for level in self.further:
            moved += evaluation.displacement(level, points)
        kernels.add_values(np.ascontiguousarray(carried).reshape(-1), moved.reshape(-1))
        return moved


class Solved(NamedTuple):
    """An interpolation: its stage, the factorization of the boundary's nodes, and its control nodes (nc,)."""

    stage: Stage
    factorization: Factorization
    control_points: Integers


@dataclass(frozen=True, eq=False)
class StandardTrial:
    """The positions of all nodes by the standard motion."""

    start: Floats  # (n, d). Positions from which the interpolation started, mesh length unit
    points: Floats  # (n, d). Trial positions
    stages: Sequence[Stage]  # The motion from ``start``, anywhere
    #: Factorization of all nodes with a role at ``start`` (with a boundary layer's outermost nodes instead of the wall
    #: behind them). With a reduction it is made at its first use. It includes periodic nodes only if an enrichment
    #: follows.
    factorization: Factorization
    #: (nc,). Control nodes of the last interpolation: all nodes with a role, or those that a reduction chose.
    control_points: Integers


@dataclass(frozen=True, eq=False)
class StandardMotion:
    """The standard motion of one mesh."""

    reference: Floats  # (n, d). Reference coordinates, mesh length unit
    roles: BoundaryRoles
    method: Method  # The method with its support radius set
    surfaces: Mapping[str, Integers]  # (p,) each. The nodes of the :func:`.whole_walls`
    sliding: SlidingSurfaces | None  # Surfaces on which ``roles.sliding`` stay; None without such nodes
    periodic: PeriodicNodes | None  # Nodes that move together; None without periodic patches
    spacing: float  # mesh length unit. Spacing of the moving nodes in the reference mesh; 0 if no reduction needs it
    plans: Mapping[bytes, TwoScalePlan]  # The sets of control nodes that are interpolated in two scales, by their bytes
    reach: Reach
    layer: BoundaryLayer | None = None  # Nodes that the moving walls carry with them

    @classmethod
    def build(
        cls,
        points: Floats,
        facets: Mapping[str, Integers],
        patches: Mapping[str, Patch],
        method: Method,
        loose: Integers | None = None,
    ) -> StandardMotion:
        """Prepare the motion of a checked mesh with reference coordinates ``points`` (n, d).

        ``facets``: those of the whole boundary (f, k), by type; the motion needs no cells. ``loose`` (l,): nodes of no
        cell and no role.

        Raises InvalidInput if the method does not fit the mesh.
        """
        roles = BoundaryRoles.from_patches(patches)
        periodic = PeriodicNodes.build(points, facets, patches, roles)
        mesh = (points, roles) if loose is None else roles.without(points, loose)
        check_method(method, *mesh, periodic=periodic is not None)
        method, reach = with_reach(method, *mesh, periodic=periodic)
        sliding, surfaces = None, whole_walls(points, facets, patches)
        if len(roles.sliding):
            images = () if periodic is None else periodic.generators
            mirrors = [name for name in surfaces if patches[name].role == "symmetry"]
            sliding = SlidingSurfaces.build(points, facets, surfaces, roles.sliding, images=images, mirrors=mirrors)
            if periodic is None or periodic.turns:  # a row of cells has no end: walls follow
                sliding = sliding.with_endless(points, periodic=periodic is not None)
        spacing = 0.0 if method.reduction == "none" else boundary_spacing(points[roles.moving])
        return cls(points, roles, method, surfaces, sliding, periodic, spacing, {}, reach).with_layer(None)

    def with_layer(self, layer: BoundaryLayer | None) -> StandardMotion:
        """The same motion with another boundary layer, or none, and so with other control points."""
        other = replace(self, layer=layer, plans={})
        if self.periodic is not None:
            return other
        followed = [nodes for nodes, wall in self.walls() if wall.freedom().any() and not wall.only_carried]
        sets = [other._controls(nodes) for nodes in (self.roles.all, *followed)]
        return replace(other, plans=plans_for(self.reference, sets, self.roles, self.method, other._smoothing))

    @property
    def _smoothing(self) -> Smoothing | None:
        return self.reach.smoothing if self.layer is None else self.reach.layer_smoothing

    def walls(self) -> Iterator[tuple[Integers, SlidingSurfaces]]:
        """The sliding nodes in the order in which they are placed, and for each part the nodes (k,) that it follows.

        Lines follow their ends, and surfaces follow their lines, so that no node passes the end of its wall.
        """
        followed = self.roles.prescribed
        for wall in () if self.sliding is None else self.sliding.by_freedom:
            yield followed, wall
            followed = np.union1d(followed, wall.nodes)

    def trial(self, committed: Floats, targets: Floats, factors: FactorSource, watch: Stopwatch) -> StandardTrial:
        """Trial positions with ``roles.moving`` at ``targets`` (k, d), bitwise; all other nodes follow.

        Parameters
        ----------
        committed : (n, d) array
            Committed positions, mesh length unit.
        targets : (k, d) array
        watch : Stopwatch
            Gains the seconds of ``solve`` and ``displace``.
        """
        if self.periodic is not None:
            self.periodic.check_targets(self.roles.moving, targets)
        start = committed if self.method.displacement == "relative" else self.reference
        waypoints = self._waypoints(start, targets) if self.method.displacement == "reanchored" else [targets]
        points, first = self._interpolate(start, waypoints[0], factors, watch)
        stages, last, factorization = [first.stage], first, first.factorization
        for waypoint in waypoints[1:]:
            points, last = self._interpolate(points, waypoint, factors, watch)
            stages.append(last.stage)
        if self.periodic is not None and self.method.correction not in ("none", "smooth", "optimised"):
            # an enrichment must vanish on periodic sides too
            nodes = np.union1d(self._controls(self.roles.all), self.roles.periodic)
            factorization = factorization_of(start[nodes], self.method, factors)
        return StandardTrial(start, points, stages, factorization, last.control_points)

    def _waypoints(self, start: Floats, targets: Floats) -> list[Floats]:
        """Positions of the moving nodes after each sub-step, the targets last."""
        origin = start[self.roles.moving]
        furthest = float(np.sqrt(np.max(np.sum((targets - origin) ** 2, axis=1))))
        outline = self.reference[np.concatenate([self.roles.all, self.roles.periodic])]
        stride = _SUBSTEP_FRACTION * float(np.ptp(bounding_box(outline), axis=0).max())
        count = min(max(math.ceil(furthest / stride), 1), _MAX_SUBSTEPS)
        path = substeps(origin, targets - origin, count)
        return [*(origin + displacement for displacement in path[:-1]), targets]

    def _interpolate(
        self, points: Floats, targets: Floats, factors: FactorSource, watch: Stopwatch
    ) -> tuple[Floats, Solved]:
        """One interpolation from the mesh ``points`` (n, d): the new positions and the solved stage."""
        roles, layer = self.roles, self.layer
        if layer is None and self.periodic is None and self.sliding is None:
            # without an array of all nodes, which takes as long as one pass over the mesh
            known = controls = roles.prescribed
            places = goal = self.reference.take(known, axis=0)
            places[roles.moving_rows] = targets
        else:
            prescribed = points.copy()
            prescribed[roles.fixed] = self.reference[roles.fixed]
            prescribed[roles.moving] = targets
            if layer is not None:
                with watch.phase("displace"):
                    prescribed[layer.nodes] = layer.carried(prescribed)
            if self.sliding is not None:
                prescribed = self._slid(points, prescribed, factors, watch)
            known, controls = self.known, self.controls
            places, goal = prescribed[known], prescribed[controls]
        solved = self.solved(points, controls, goal, factors, watch)
        with watch.phase("displace"):
            found, prepared = solved.stage.interpolant, None
            if isinstance(found, TwoScaleInterpolant):
                prepared = operators_of(found.levels, points, factors, skipped=known)
            moved = solved.stage.positions(points, prepared)
            numbers = known[:, None] * moved.shape[1] + np.arange(moved.shape[1])
            moved.reshape(-1)[numbers.reshape(-1)] = places.reshape(-1)  # moved[known] = places, in a third of the time
            return self.tied(moved), solved

    def _slid(self, points: Floats, prescribed: Floats, factors: FactorSource, watch: Stopwatch) -> Floats:
        """The ``prescribed`` positions (n, d) with the sliding nodes on their surfaces."""
        for followed, wall in self.walls():
            places = points[wall.nodes]
            if wall.freedom().any():  # corners stay in place
                controls = self.control_nodes(followed)
                if wall.only_carried:
                    rigid = self.carry(points, points[controls], prescribed[controls])
                    places = places if rigid is None else rigid.apply(places)
                else:
                    following = self.solved(points, controls, prescribed[controls], factors, watch).stage
                    with watch.phase("displace"):
                        places = following.positions(places)
            known = np.zeros(len(points), dtype=bool) if self.layer is None else self.layer.known.copy()
            own = ~known[wall.nodes]
            prescribed[wall.nodes[own]] = wall.project(places)[own]
            prescribed = self.tied(prescribed)
            if 1 in wall.freedom():
                known[followed] = True
                placed = prescribed if wall.only_carried else wall.evened(points, prescribed, known)
                prescribed[wall.nodes] = wall.project(wall.in_order(placed, known)[wall.nodes])
        return prescribed

    def _controls(self, nodes: Integers) -> Integers:
        """The control nodes for nodes (c,) with a role: a layer's outermost nodes replace the nodes behind them."""
        return nodes if self.layer is None else self.layer.shield.instead(nodes)

    def control_nodes(self, nodes: Integers) -> Integers:
        """The control nodes for nodes (c,) with a role: one node of each periodic orbit stands for its images."""
        controls = self._controls(nodes)
        return controls if self.periodic is None else np.unique(self.periodic.root_of(controls))

    @cached_property
    def controls(self) -> Integers:
        """(c,) the control nodes of all nodes with a role."""
        return self.control_nodes(self.roles.all)

    @cached_property
    def known(self) -> Integers:
        """(k,) nodes that the interpolation does not place: those with a role, and those of the layer."""
        return self.roles.all if self.layer is None else np.union1d(self.roles.all, self.layer.nodes)

    def solved(
        self, points: Floats, controls: Integers, goal: Floats, factors: FactorSource, watch: Stopwatch
    ) -> Solved:
        """The interpolation that takes the control nodes (c,) from ``points`` (n, d) to ``goal`` (c, d)."""
        with watch.phase("solve"):
            origin = points.take(controls, axis=0)  # three times as fast as points[controls]
            rigid = None
            if not len(self.roles.fixed):
                rigid = self.carry(points, origin, goal)
            displacement = goal - (origin if rigid is None else rigid.apply(origin))
            if self.periodic is not None or self.method.reduction == "none":
                factorization = self._all_factorized(points, origin, controls, factors)
                return Solved(Stage(rigid, factorization.solve(displacement)), factorization, controls)
            reduced = interpolate_reduced(origin, displacement, self.method, factors, spacing=self.spacing)
            return Solved(
                Stage(rigid, reduced.levels[0], reduced.levels[1:]),
                DeferredFactorization(origin, self.method, factors),
                controls[reduced.selected],
            )

    def carry(self, points: Floats, origin: Floats, goal: Floats) -> RigidMotion | None:
        """The rigid motion of the mesh ``points`` (n, d) closest to that of control nodes, if its walls admit it."""
        rigid = None if np.array_equal(origin, goal) else self.fitted(origin, goal)  # nodes at rest keep their bits
        if rigid is None or self.sliding is None:
            return rigid
        return self.sliding.admitted(rigid, points[self.sliding.nodes])

    def fitted(self, origin: Floats, goal: Floats) -> RigidMotion | None:
        """The rigid motion closest to that of control nodes from origin to goal (c, d), without regard to the walls."""
        if len(self.roles.fixed):
            return None
        if self.periodic is not None:
            return self.periodic.carry(origin, goal)
        if self.sliding is None or (self.sliding.turns and self.sliding.axis is None):
            return fit_rigid_motion(origin, goal)
        if self.sliding.axis is None:
            return None
        return replace(fit_screw(origin, goal, self.sliding.axis), translation=np.zeros(origin.shape[1]))

    def factorized(self, controls: Integers, factors: FactorSource) -> Factorization:
        """The factorization of control nodes (c,) in the reference mesh, without reduction."""
        return self._all_factorized(self.reference, self.reference.take(controls, axis=0), controls, factors)

    def _all_factorized(
        self, points: Floats, origin: Floats, controls: Integers, factors: FactorSource
    ) -> Factorization:
        """The factorization of all control nodes (c,), at ``origin`` (c, d) in the mesh ``points`` (n, d)."""
        if self.periodic is not None:
            images, box = self.periodic.generators, bounding_box(points)
            return periodic_factorization_of(
                origin, images, box, self.method, factors, self.periodic.open_sector,
                self._smoothing, ~self._fixed[controls],
            )  # fmt: skip
        plan = self.plans.get(controls.tobytes())
        try:
            if plan is None:
                found = factorization_of(origin, self.method, factors)
            else:
                found = two_scale_factorization_of(origin, bounding_box(points), plan, factors)
        except QualityRefused:
            if not basis_named(self.method.basis).compact:
                raise
            # the boundary has changed too much for the reference mesh's plan
            plan = plan_for(points, controls, self.roles, self.method, self._smoothing)
            found = two_scale_factorization_of(origin, bounding_box(points), plan, factors)
        if not self.reach.mean_radius:
            return found
        return FarFieldFactorization(found, np.flatnonzero(~self._still[controls]), self.reach.mean_radius)

    @cached_property
    def _fixed(self) -> Marks:
        """(n,) whether each node is fixed."""
        return marks_at(len(self.reference), self.roles.fixed)

    @cached_property
    def _still(self) -> Marks:
        """(n,) whether each node is fixed or slides."""
        return marks_at(len(self.reference), self.roles.fixed, self.roles.sliding)

    def tied(self, positions: Floats) -> Floats:
        """Positions (n, d) with periodic images placed by their roots, except the moving nodes."""
        return positions if self.periodic is None else self.periodic.tied(positions, left=self.roles.moving)
