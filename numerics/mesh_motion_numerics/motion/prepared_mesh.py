"""The constant data that every motion of a session needs: the reference mesh, its roles, and derived data."""

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.correction.boundary_constraint import BoundaryConstraint
from mesh_motion_numerics.correction.smooth_motion import SmoothMotion
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets, boundary_nodes
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.plane_rims import PlaneRims
from mesh_motion_numerics.mesh.points import marks_at
from mesh_motion_numerics.mesh.roles import BoundaryRoles, Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.body_paths import Body, moving_bodies
from mesh_motion_numerics.motion.boundary_layer import BoundaryLayer
from mesh_motion_numerics.motion.contact_ahead import ContactAhead
from mesh_motion_numerics.motion.crossing import PossibleCrossing
from mesh_motion_numerics.motion.layered_walls import LayeredWalls
from mesh_motion_numerics.motion.standard_motion import StandardMotion
from mesh_motion_numerics.motion.winding import Winding, winding_body
from mesh_motion_numerics.quality.headroom import HORIZON, Headroom, headroom
from mesh_motion_numerics.quality.mesh_check import CheckedMesh, checked_mesh
from mesh_motion_numerics.quality.metrics import AtRest, CellQuality, cells_at_rest
from mesh_motion_numerics.quality.quality_summary import Judgement, judged_mesh, summarize

#: Steps to the first inversion by straight ways, below which the end of the smooth correction is looked for.
_SOON = 20.0


@dataclass(frozen=True, eq=False)
class PreparedMesh:
    """A checked mesh with a method, prepared for its motions."""

    points: Floats  # (n, d). Reference coordinates, mesh length unit
    cells: CellTable
    roles: BoundaryRoles
    method: Method  # The method with both radii set
    #: (m,) or CellsAtRest. Summed corner determinants of the reference cells: the w of thesis (3.21); with their skews
    #: if the metric uses them.
    reference_sizes: AtRest
    held: Marks  # (n,). Nodes on the boundary or on a patch. No correction may move them
    standard_motion: StandardMotion
    constraint: BoundaryConstraint | None  # Which of the held nodes the optimised correction may still move, and how
    coincident: Integers  # (c, 2). Boundary nodes at the same place: the first one, and another one
    rims: PlaneRims | None  # Moving nodes on plane slip and symmetry walls; None without such walls
    warnings: tuple[str, ...]  # The warnings of :func:`checked_mesh`
    smooth: SmoothMotion | None = None  # The prepared correction "smooth"; None with every other correction
    #: Walls whose layers move with them if interpolation would spoil the layers; None without such walls.
    layered: LayeredWalls | None = None
    distributions: bool = True  # Whether a judgement contains the distributions, or the worst cells alone

    @classmethod
    def build(
        cls,
        points: Floats,
        cells: CellTable,
        patches: Mapping[str, Patch],
        method: Method,
        checked: CheckedMesh | None = None,
    ) -> Self:
        """Check the mesh, unless it is ``checked`` already, and prepare what every motion needs.

        Raises InvalidInput if the mesh or a patch is unusable (see :func:`checked_mesh`), or the method does not fit
        the mesh.
        """
        cells, sizes, warnings, resting, coincident, loose = checked or checked_mesh(points, cells, patches)
        if len(resting):
            patches = {**patches, "": Patch("fixed", resting)}
        at_rest = cells_at_rest(points, cells, sizes) if method.quality_metric == "relative-size-skew" else sizes
        facets = boundary_facets(cells)
        motion = StandardMotion.build(points, facets, patches, method, loose)
        roles, method = motion.roles, motion.method
        held = marks_at(len(points), boundary_nodes(cells), roles.all)
        constraint = BoundaryConstraint.build(points, facets, patches, motion.surfaces, motion.sliding, motion.periodic)
        is_smooth = method.correction == "smooth"
        smooth = SmoothMotion.build(points, cells, held, constraint) if is_smooth else None
        layered = LayeredWalls.build(points, cells, patches, motion.sliding, first_cells=is_smooth)
        return cls(
            points,
            cells,
            roles,
            method,
            at_rest,
            held,
            motion,
            constraint,
            coincident,
            PlaneRims.build(points, facets, patches, motion.surfaces, roles.moving),
            tuple(warnings),
            smooth,
            layered,
        )

    def without_distributions(self) -> Self:
        """The same mesh, judged exactly by its worst cells, without distributions."""
        return self._brief

    @cached_property
    def _brief(self) -> Self:
        other = copy(self)  # with the data that are already prepared: later coupling iterations use this mesh
        object.__setattr__(other, "distributions", False)
        return other

    def with_method(self, **choices: Any) -> Self:
        """The same mesh with other choices of its method that need no new preparation."""
        method = replace(self.method, **choices)
        smooth = self.smooth if method.correction == "smooth" else None
        return replace(self, method=method, smooth=smooth, standard_motion=replace(self.standard_motion, method=method))

    @cached_property
    def boundary(self) -> PossibleCrossing:
        """The boundary of the mesh, with its tests for crossings."""
        sliding, periodic = self.standard_motion.sliding, self.standard_motion.periodic
        images = () if periodic is None else periodic.generators
        return PossibleCrossing.build(self.points, self.cells, self.roles, self.coincident, sliding, images)

    def headroom(self, before: Floats, points: Floats, worst: Integers, *, step: bool = True) -> Headroom:
        """The number of further steps like that from ``before`` (n, d) which the mesh at ``points`` (n, d) admits.

        ``worst`` (w,) are the worst cells there, as a judgement names them. The smooth correction keeps all cells valid
        until the boundary meets itself. ``step``: it is the run's last step, so the fall of the qualities in it counts.
        """
        metric, threshold = self.method.quality_metric, self.method.quality_threshold
        resisting = step and self.smooth is not None and threshold < self.smooth.law.limit
        found = headroom(
            points, before, self.cells, self.reference_sizes, metric, threshold, worst, self.cells_at_moving, resisting
        )
        contact = self.contact if self.smooth is not None and 0.0 < found.inversion < _SOON else None
        if contact is None:
            return found
        return replace(found, inversion=max(found.inversion, contact.steps(points, before, HORIZON)))

    @cached_property
    def contact(self) -> ContactAhead | None:
        """The boundary, if its nodes have known places; None too if parts of it meet at rest."""
        facets, boundary = self.boundary.facets, boundary_facets(self.cells)
        whole = {name: len(nodes) for name, nodes in boundary.items()} == {k: len(v) for k, v in facets.nodes.items()}
        if not whole or len(self.boundary.sides.pairs) or self.cells.dimension < 2:
            return None
        stiff = self.cells.within(marks_at(len(self.points), self.roles.prescribed))
        return ContactAhead.build(facets, self.points, self.cells.chosen(stiff) if stiff.any() else None)

    @cached_property
    def cells_at_moving(self) -> Integers:
        """(k,) numbers of the cells with a facet on the moving boundary, ascending."""
        moving = marks_at(len(self.points), self.roles.moving)
        of_facet = self.cells.dimension
        return np.flatnonzero(np.concatenate([moving[block.nodes].sum(axis=1) >= of_facet for block in self.cells]))

    def summary(self, points: Floats, quality: CellQuality | None = None) -> Judgement:
        """Quality of the mesh with its nodes at ``points`` (n, d), size relative to the reference mesh.

        If the ``quality`` of every cell at these points is given, no cell is judged again.
        """
        if quality is not None:
            metric = self.method.quality_metric
            return summarize(quality, points, self.cells, metric=metric, distributions=self.distributions)
        return self.judged(points)[0]

    def judged(self, points: Floats, limit: float = 0.0) -> tuple[Judgement, Integers]:
        """The :meth:`summary`, and the cells whose worst corner is below a limit (:func:`.judged_mesh`)."""
        metric, full = self.method.quality_metric, self.distributions
        return judged_mesh(points, self.cells, self.reference_sizes, metric=metric, distributions=full, limit=limit)

    @cached_property
    def carrying_layers(self) -> StandardMotion:
        """The standard motion with the layer of the layered walls."""
        layer = None if self.layered is None else self.layered.layer
        return self.standard_motion if layer is None else self.standard_motion.with_layer(layer)

    @cached_property
    def bodies(self) -> tuple[Body, ...]:
        """The bodies of the moving boundary."""
        return moving_bodies(self.cells, self.roles.moving)

    @cached_property
    def winding(self) -> Winding | None:
        """The bodies that may wind the mesh of a smooth motion; None without such bodies."""
        smooth, layer = self.smooth, self.carrying_layers.layer
        if smooth is None or not len(self.roles.fixed):
            return None
        simplices = self.cells.corner_nodes
        found = (
            winding_body(self.points, simplices, self.roles.moving[body.rows], body.rows, self.roles.fixed)
            for body in self.bodies
            if not len(body.seam) and not np.isin(self.roles.moving[body.rows], self.roles.periodic).any()
        )
        bodies = tuple(body for body in found if body is not None)
        if not bodies:
            return None
        held = self.held_with(layer)
        return Winding(self.points, self.roles.moving, held, simplices, layer, lambda: smooth.averages, bodies)

    def motion_with(self, layer: BoundaryLayer) -> StandardMotion:
        """The standard motion with this layer, which is mostly the whole layer of the walls."""
        whole = self.carrying_layers
        return whole if layer is whole.layer else self.standard_motion.with_layer(layer)

    def held_with(self, layer: BoundaryLayer | None) -> Marks:
        """The held nodes (n,) and those of this boundary layer."""
        return self.held if layer is None else self.held | layer.known

    def constraint_with(self, layer: BoundaryLayer | None) -> BoundaryConstraint | None:
        """The constraint of the boundary nodes that are not in this boundary layer."""
        if self.constraint is None or layer is None:
            return self.constraint
        return replace(self.constraint, released=self.constraint.released & ~layer.known)
