"""The motion of a boundary whose volume is in other processes: gives the field, corrects regions, judges nothing.

The field is that of :class:`.standard_motion.StandardMotion` from the reference mesh with the whole displacement. It
depends only on the nodes with a role, the facets of the boundary and the box of the mesh. So it is the field of the
whole mesh: bitwise if all nodes with a role are moving or fixed, and to rounding if some slide.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NoReturn, Self

import numpy as np
from mesh_motion_protocol.errors import InvalidInput, QualityRefused, SessionError

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.blas import one_blas_thread
from mesh_motion_numerics.correction.boundary_constraint import BoundaryConstraint
from mesh_motion_numerics.correction.correction import Correction, correct
from mesh_motion_numerics.correction.correction_problem import CorrectionProblem
from mesh_motion_numerics.correction.part_of_mesh import Elsewhere
from mesh_motion_numerics.correction.smooth_motion import Law, SmoothMotion
from mesh_motion_numerics.interpolation.factor_source import DeferredFactorization, FactorSource, MakeEachTime, Recorded
from mesh_motion_numerics.interpolation.interpolation_map import FieldMap
from mesh_motion_numerics.mesh.boundary_layer_wall import MovingWall
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.patch_check import check_patches
from mesh_motion_numerics.mesh.plane_rims import PlaneRims
from mesh_motion_numerics.mesh.points import bounding_box
from mesh_motion_numerics.mesh.roles import SLIDING_ROLES, BoundaryRoles, Patch, nodes_with
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.body_paths import Body, Way, ways
from mesh_motion_numerics.motion.layered_walls import LayeredWalls
from mesh_motion_numerics.motion.motion_found import BoundaryDisplacement, Motion
from mesh_motion_numerics.motion.motion_slope import PlainSlope, plain_slope, why_no_slope
from mesh_motion_numerics.motion.smooth_step import PlainWay, smooth_step
from mesh_motion_numerics.motion.standard_motion import StandardMotion
from mesh_motion_numerics.motion.winding import turned_on
from mesh_motion_numerics.quality.headroom import Headroom
from mesh_motion_numerics.quality.mesh_check import checked_cells
from mesh_motion_numerics.quality.metrics import cells_at_rest
from mesh_motion_numerics.quality.quality_summary import Judgement, LowestQuality, Minimum
from mesh_motion_numerics.stopwatch import Stopwatch, check_time

#: Share of the box's diagonal: a node this near to a wall is on it, for the coordinates of any partition.
_ON_WALL = 1e-9
#: Degrees: a rotation this near to half a turn may have either direction.
_UNCERTAIN = 1e-6
#: Corrections for a role: those that ignore it, or know it. Other corrections judge whether nodes slide, or hold them.
_CORRECTIONS = {"slip": ("smooth",), "symmetry": ("smooth",), "periodic": ("none", "smooth")}


@dataclass(frozen=True, eq=False)
class BoundaryMotion:
    """The boundary of a mesh with its motions."""

    motion: StandardMotion  # Motion of the nodes of the boundary, and of those that span the box of the mesh
    bodies: Mapping[str, Body]  # The moving patches
    rims: PlaneRims | None  # Moving nodes on plane slip and symmetry walls
    constraint: BoundaryConstraint | None  # Constraint of the nodes on walls that the smooth correction may move
    warnings: tuple[str, ...] = ()

    @classmethod
    def build(
        cls,
        points: Floats,
        facets: Mapping[str, Integers],
        near: CellTable,
        patches: Mapping[str, Patch],
        method: Method,
    ) -> Self:
        """Check the nodes (n, d) and prepare their motions.

        ``facets`` (f, k): all facets of the boundary, by type; not needed if all patches are moving or fixed, and no
        layer is carried. ``near``: the cells at nodes within some distance of the moving walls.

        Raises InvalidInput if a patch is unusable or has a role for which the correction needs the volume, if no node
        is fixed, or if the method does not fit the mesh.
        """
        check_patches(len(points), patches)
        for name, patch in patches.items():
            admitted = _CORRECTIONS.get(patch.role, (method.correction,))
            if method.correction not in admitted:
                raise _needs_the_volume(
                    f"patch {name!r} has the role {patch.role!r}: expected correction = "
                    f"{' or '.join(map(repr, admitted))}, got {method.correction!r}",
                    name,
                )
        roles = BoundaryRoles.from_patches(patches)
        if not len(roles.fixed):
            raise _needs_the_volume("no node is fixed, expected at least one")
        if points.shape[1] == 3 and len(nodes_with(patches, SLIDING_ROLES)) == len(points):
            raise _needs_the_volume(
                "all nodes are on slip or symmetry patches, as those of one layer of cells, whose plane the cells say"
            )
        motion = StandardMotion.build(points, facets, patches, method)
        constraint = BoundaryConstraint.build(points, facets, patches, motion.surfaces, motion.sliding, motion.periodic)
        smooth = None if constraint is None else constraint.smooth()
        if len(near):
            layered = LayeredWalls.build(points, near, patches, motion.sliding, facets, first_cells=True)
            motion = motion if layered is None else motion.with_layer(layered.layer)
        rims = PlaneRims.build(points, facets, patches, motion.surfaces, roles.moving)
        return cls(motion, _bodies(roles, patches), rims, smooth)

    @property
    def method(self) -> Method:
        """The method with both radii set."""
        return self.motion.method

    def without_distributions(self) -> Self:
        """The same object: it judges nothing."""
        return self

    def summary(self, points: Floats) -> Judgement:
        """Refuse to judge.

        Raises SessionError always: the cells are in other processes.
        """
        del points
        raise SessionError("the trial is not judged, or it was refused", hint="send JUDGE from every partition first")

    def headroom(self, before: Floats, points: Floats, worst: Integers, *, step: bool = True) -> Headroom:
        """Refuse, as :meth:`summary` does."""
        del before, points, worst, step
        raise SessionError("the headroom is not known here: the client has the cells")

    def why_no_slope(self) -> InvalidInput | None:
        """The reason why the motion has no derivative; None if it has one."""
        return why_no_slope(self.motion)

    def slope(self, points: Floats, factors: FactorSource) -> NoReturn:
        """Refuse, as :meth:`summary` does; the field has a derivative, see :meth:`field_map`."""
        del points, factors
        raise SessionError("the derivative of all nodes is not known here: the client has the volume")

    def field_map(self, factors: FactorSource) -> FieldMap:
        """The field as a function of the displacements of its control nodes."""
        return FieldMap(self.motion.factorized(self.motion.controls, factors), factors)

    def plain_slope(self, points: Floats, factors: FactorSource) -> PlainSlope:
        """The derivative of the motion of these nodes that has led to ``points`` (n, d), without a correction.

        Raises QualityRefused if there is no derivative at these points.
        """
        motion = self.motion
        plain = motion.trial(motion.reference, points[motion.roles.moving], factors, Stopwatch()).points
        return plain_slope(motion, plain, factors)

    def move(
        self,
        committed: Floats,
        targets: Floats,
        factors: FactorSource | None = None,
        *,
        boundary_displacement: BoundaryDisplacement | None = None,
    ) -> Motion:
        """Move the nodes (n, d) so that the moving ones are at ``targets`` (k, d); the quality is unknown."""
        del boundary_displacement
        check_time()
        warnings = [] if self.rims is None else self.rims.check(targets)
        self._refuse_winding(committed, targets)
        watch, recorded = Stopwatch(), Recorded(MakeEachTime() if factors is None else factors)
        trial = self.motion.trial(committed, targets, recorded, watch)
        unknown = LowestQuality(Minimum(float("nan")), 0, 0, ())
        return Motion(
            points=trial.points,
            standard=unknown,
            corrected=unknown,
            correction=Correction(trial.points, trial.points[:0]),
            reached=False,
            seconds=watch.seconds(),
            caches=dict(recorded.found),
            control_points=trial.control_points,
            support_radius=float(self.method.support_radius or 0.0),
            warnings=warnings,
            field=trial.stages[0].interpolant,
        )

    def _refuse_winding(self, committed: Floats, targets: Floats) -> None:
        """Raise if a body turns beyond half a turn: the whole mesh would have to wind, and the field cannot do this."""
        if self.method.correction != "smooth" or committed.shape[1] == 1:
            return
        moving, periodic = self.motion.roles.moving, self.motion.roles.periodic
        for name, body in self.bodies.items():
            if np.isin(moving[body.rows], periodic).any():
                continue  # the body winds no mesh
            rest, was = (points[moving[body.rows]] for points in (self.motion.reference, committed))
            before, after = (np.degrees(angle) for angle in turned_on(rest, was, targets[body.rows]))
            if abs(after) > 180.0 + _UNCERTAIN and abs(before) < 180.0 - _UNCERTAIN:
                raise QualityRefused(
                    f"evaluation = 'client': patch {name!r} turns from {before:.5g}° to {after:.5g}°, expected at most "
                    "half a turn: a mesh on the solver's own ranks cannot be wound",
                    code="FAILED_PRECONDITION",
                    hint="open the session with evaluation = 'server', or turn back",
                    details={"patch": name},
                )

    @cached_property
    def optimised(self) -> Self:
        """The same motion with the correction up to the threshold, which reaches most if no smooth motion is found."""
        if self.method.correction != "smooth":
            return self
        method = replace(self.method, correction="optimised", correction_target="threshold")
        return replace(self, motion=replace(self.motion, method=method))

    def ways(self, targets: Floats) -> Iterator[Way]:
        """Ways of the moving nodes from the reference mesh to the ``targets`` (k, d)."""
        origin = self.motion.reference[self.motion.roles.moving]
        bodies = self.bodies.values() if self.motion.periodic is None else ()  # images must move together
        return ways(origin, targets, tuple(bodies))

    @property
    def orbits(self) -> Integers:
        """(n,) the node that represents each node and its periodic images."""
        nodes = np.arange(len(self.motion.reference))
        return nodes if self.motion.periodic is None else self.motion.periodic.root_of(nodes)

    def smoothed(
        self,
        points: Floats,
        positions: Floats,
        cells: CellTable,
        held: Marks,
        elsewhere: Elsewhere,
        n_nodes: int,
        rows: Integers,
        ways: Iterable[PlainWay],
    ) -> Correction:
        """The smooth correction of a region, bitwise that of a mesh of ``n_nodes`` that begins with interpolation.

        Raises RegionTooSmall if a larger region is needed. Raises QualityRefused if no valid mesh was found.

        Parameters
        ----------
        points, positions, cells, held, elsewhere
            As in :meth:`corrected`.
        rows : (n,) int64 array
            The row of each node in the boundary; -1 if it is not there.
        ways : iterable of callable
            Fraction → positions (n, d) by interpolation, from the reference mesh to the ``positions``: tried in turn if
            no valid mesh is found in one step.
        """
        check_time()
        smooth = self.smooth(points, cells, held, elsewhere, n_nodes, rows)
        with one_blas_thread():
            return smooth_step(smooth, points, lambda: points, positions, lambda: ways).correction()

    def smooth(
        self, points: Floats, cells: CellTable, held: Marks, elsewhere: Elsewhere, n_nodes: int, rows: Integers
    ) -> SmoothMotion:
        """Return the correction of a region for :meth:`smoothed`."""
        read = checked_cells(points, cells)
        constraint = None if self.constraint is None else self.constraint.renumbered(rows, points)
        held = held if constraint is None else held & ~constraint.released
        return SmoothMotion(points, read.cells, held, Law.of(n_nodes), constraint, elsewhere)

    def corrected(
        self, points: Floats, positions: Floats, cells: CellTable, held: Marks, elsewhere: Elsewhere
    ) -> Correction:
        """The correction of a region of the mesh up to the threshold, bitwise that of the whole mesh.

        Raises RegionTooSmall if a larger region is needed. Raises QualityRefused if no valid mesh was found.

        Parameters
        ----------
        points, positions : (n, d) arrays, mesh length unit
            Positions in the reference mesh, and after the interpolation.
        held : (n,) bool array
        """
        check_time()
        read = checked_cells(points, cells)
        relative = self.method.quality_metric == "relative-size-skew"
        problem = CorrectionProblem(
            start=points,
            standard=positions,
            held=held,
            cells=read.cells,
            reference_sizes=cells_at_rest(points, read.cells, read.sizes) if relative else read.sizes,
            factorization=DeferredFactorization(points, self.method, MakeEachTime()),  # no correction here uses it
            reference=points,
            elsewhere=elsewhere,
        )
        return correct(problem, self.method)


def reach_of_layers(
    points: Floats, facets: Mapping[str, Integers], near: CellTable, patches: Mapping[str, Patch], method: Method
) -> tuple[float, MovingWall | None]:
    """The distance from the moving walls within which the cells at nodes are needed for layers.

    Parameters
    ----------
    near : CellTable
        The cells at the nodes on the walls, or more; empty: no cell is known yet.

    Returns
    -------
    float, MovingWall
        Nodes within this distance of this wall, mesh length unit; 0 if no wall has layers, or the method carries none.
    """
    wall = MovingWall.of_patches(points, facets, patches) if facets and method.correction == "smooth" else None
    if wall is None:
        return 0.0, None
    if len(near):
        layered = LayeredWalls.build(points, near, patches, None, facets, first_cells=True)
        reach = 0.0 if layered is None else layered.reach
    else:
        reach = _ON_WALL * float(np.linalg.norm(np.ptp(bounding_box(points), axis=0)))
    return reach, wall


def _bodies(roles: BoundaryRoles, patches: Mapping[str, Patch]) -> dict[str, Body]:
    """The moving patches as bodies: only the cells in other processes show which patches are connected."""
    left, bodies = np.ones(len(roles.moving), dtype=bool), {}
    for name, patch in patches.items():
        rows = np.flatnonzero(left & np.isin(roles.moving, patch.nodes)) if patch.role == "moving" else np.empty(0, int)
        left[rows] = False
        if len(rows):
            bodies[name] = Body(rows, np.empty(0, dtype=np.int64))
    return bodies


def _needs_the_volume(what: str, patch: str = "") -> InvalidInput:
    return InvalidInput(
        f"evaluation = 'client': {what}",
        code="INVALID_ARGUMENT.MESH",
        hint="give it the role moving or fixed, or open the session with evaluation = 'server'",
        details={"patch": patch} if patch else {},
    )
