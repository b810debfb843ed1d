"""The motion of one layer of cells between two parallel planes: that of the front plane, equal on both planes.

In 3D every node of such a mesh slides, and a patch on both planes is neither planar nor smooth. So the mesh is moved
and judged in 2D (:mod:`~mesh_motion_numerics.mesh.one_layer`), as between OpenFOAM's `empty` patches.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.interpolation.factor_source import FactorSource
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.one_layer import OneLayer
from mesh_motion_numerics.mesh.roles import BoundaryRoles, Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.motion.motion_found import BoundaryDisplacement, Motion
from mesh_motion_numerics.motion.motion_slope import MotionSlope
from mesh_motion_numerics.quality.headroom import Headroom
from mesh_motion_numerics.quality.mesh_check import checked_mesh
from mesh_motion_numerics.quality.quality_summary import Judgement

#: The warning that such a mesh gets.
AS_A_PLANE = "the mesh is one layer of cells between two parallel planes: it is moved in the plane, both sides alike"
#: Displacements across the layer, and differences between its two planes, are rounding up to this share of the extent.
_ROUNDING = 1e-9


def motion_model(
    points: Floats, cells: CellTable, patches: Mapping[str, Patch], method: Method
) -> MotionModel | OneLayerMotion:
    """The model of a mesh, in 2D if the mesh is one layer between sliding planes; errors as in the model."""
    checked = checked_mesh(points, cells, patches)
    layer = OneLayer.find(points, checked.cells, patches)
    if layer is None:
        return MotionModel.build(points, cells, patches, method, checked)
    plane = MotionModel.build(layer.project(points), layer.cells, layer.patches, method)
    moving = BoundaryRoles.from_patches(patches).moving
    return OneLayerMotion(points, checked.cells, layer, plane, moving, (*checked.warnings, AS_A_PLANE))


@dataclass(frozen=True, eq=False)
class OneLayerMotion:
    """A mesh of one layer, and the 2D model of its plane."""

    points: Floats  # (n, 3), mesh length unit. Reference coordinates
    cells: CellTable  # the 3D cells; the plane's cells have the same numbers
    layer: OneLayer
    plane: MotionModel  # model of the front nodes; the back nodes are in none of its cells
    moving: Integers  # (k,). Nodes of the moving patches, on the front and the back plane
    warnings: tuple[str, ...]

    @property
    def method(self) -> Method:
        """The method with both radii set."""
        return self.plane.method

    def summary(self, points: Floats) -> Judgement:
        """Quality of the plane with the nodes at ``points`` (n, 3)."""
        return self._in_space(self.plane.summary(self.layer.project(points)), points)

    def headroom(self, before: Floats, points: Floats, worst: Integers, *, step: bool = True) -> Headroom:
        """The result of :meth:`.PreparedMesh.headroom` for the plane."""
        return self.plane.headroom(self.layer.project(before), self.layer.project(points), worst, step=step)

    def without_distributions(self) -> Self:
        """The same, judged exactly by its worst cells, without distributions."""
        return replace(self, plane=self.plane.without_distributions())

    def with_method(self, **choices: Any) -> Self:
        """The same mesh with other choices of its method that need no new preparation."""
        return replace(self, plane=self.plane.with_method(**choices))

    def move(
        self,
        committed: Floats,
        targets: Floats,
        factors: FactorSource | None = None,
        *,
        boundary_displacement: BoundaryDisplacement | None = None,
    ) -> Motion:
        """The motion that takes the moving nodes to ``targets`` (k, 3); as :meth:`.motion.MotionModel.move`.

        Raises InvalidInput if a node leaves its plane, or two opposite nodes move apart; names the first.
        """
        aimed = self.points.copy()
        aimed[self.moving] = targets
        self._check(targets - self.points[self.moving], float(np.ptp(self.points, axis=0).max()))
        begin, end = self.layer.project(committed), self.layer.project(aimed)
        rows = self._rows_in_front()
        whole = None
        if boundary_displacement is not None:
            origin = self.layer.project(boundary_displacement.origin)[rows]
            whole = BoundaryDisplacement(origin, end[self.moving[rows]] - origin)
        motion = self.plane.move(begin, end[self.moving[rows]], factors, boundary_displacement=whole)
        front = self.layer.front
        points = self.layer.moved(committed, begin[front], motion.points[front])
        points[self.moving] = targets
        correction = replace(
            motion.correction, points=points, enrichment_points=self._places(motion.correction.enrichment_points)
        )
        return replace(
            motion,
            points=points,
            standard=self._in_space(motion.standard, points),
            corrected=self.summary(points),
            correction=correction,
        )

    def why_no_slope(self) -> InvalidInput | None:
        """The reason why the motion has no derivative; None if it has one."""
        return self.plane.why_no_slope()

    def slope(self, points: Floats, factors: FactorSource) -> OneLayerSlope:
        """The derivative of the motion that has led to ``points`` (n, 3); errors as :meth:`.MotionModel.slope`."""
        return OneLayerSlope(self, self.plane.slope(self.layer.project(points), factors))

    def _rows_in_front(self) -> Integers:
        """For each moving node of the plane, the first row of the moving nodes that belongs to it."""
        found, rows = np.unique(self.layer.front[self.moving], return_index=True)
        assert np.array_equal(found, self.plane.roles.moving)
        return np.asarray(rows, dtype=np.int64)

    def _check(self, moved: Floats, scale: float) -> None:
        """Refuse displacements or velocities (k, 3) with which moving nodes leave the plane or the opposite node.

        ``scale``: the magnitude of these vectors.
        """
        least = _ROUNDING * scale
        across = np.abs(moved - moved @ self.layer.axes.T @ self.layer.axes).max(axis=1, initial=0.0)
        shift = np.full_like(self.points, np.nan)
        shift[self.moving] = moved
        apart = np.abs(moved - shift[self.layer.front[self.moving]]).max(axis=1, initial=0.0)
        for distances, what in (
            (across, "across the layer"),
            (np.nan_to_num(apart), "otherwise than its opposite node"),
        ):
            wrong = np.flatnonzero(distances > least)
            if len(wrong):
                node = int(self.moving[wrong[0]])
                raise InvalidInput(
                    f"node {node} moves {what}, by {distances[wrong[0]]:.3g}, but the mesh is one layer of cells "
                    "between two planes, which moves in its plane only",
                    hint="for a motion in 3D give one of the planes the role fixed and the other one slip",
                    details={"node": node, "distance": float(distances[wrong[0]])},
                )

    def _places(self, places: Floats) -> Floats:
        """(k, 3) places in the middle of the layer, from the coordinates (k, 2) in the plane."""
        normal = np.cross(*self.layer.axes)
        return places @ self.layer.axes + np.outer(np.full(len(places), (self.points @ normal).mean()), normal)

    def _in_space(self, quality: Judgement, points: Floats) -> Judgement:
        """The quality with the worst cells' centres in 3D, for nodes at ``points`` (n, 3)."""
        centres = self.cells.centres(points, np.array([cell.number for cell in quality.worst], dtype=np.int64))
        worst = tuple(
            replace(cell, centre=tuple(centre.tolist())) for cell, centre in zip(quality.worst, centres, strict=True)
        )
        return replace(quality, worst=worst)


@dataclass(frozen=True, eq=False)
class OneLayerSlope:
    """The derivative J of all nodes' positions by those of the moving nodes, which stay in their plane and opposite.

    From other velocities it uses only the part of this kind. So Jᵀ w is also of this kind.
    """

    model: OneLayerMotion
    plane: MotionSlope

    def tangent(self, velocity: Floats) -> Floats:
        """(n, 3) J v: velocities of all nodes for velocities (k, 3) of the moving nodes, in their order.

        Raises InvalidInput if a node leaves its plane, or two opposite nodes move apart; names the first.
        """
        model, layer = self.model, self.model.layer
        model._check(velocity, float(np.abs(velocity).max(initial=0.0)))
        found = self.plane.tangent(self._means(velocity @ layer.axes.T))[layer.front] @ layer.axes
        found[model.moving] = velocity
        return np.asarray(found)

    def cotangent(self, weights: Floats) -> Floats:
        """(k, 3) Jᵀ w: the derivative of Σ w · y by the moving nodes' positions, for (n, 3) weights w of all nodes."""
        layer = self.model.layer
        summed = np.zeros((len(weights), 2))
        np.add.at(summed, layer.front, weights @ layer.axes.T)
        found = self.plane.cotangent(summed) / self._counts[:, None]
        return np.asarray(found[self._places] @ layer.axes)

    def _means(self, values: Floats) -> Floats:
        """(k', 2) means of values (k, 2) for the plane's moving nodes."""
        sums = np.zeros((len(self._counts), 2))
        np.add.at(sums, self._places, values)
        return np.asarray(sums / self._counts[:, None])

    @cached_property
    def _places(self) -> Integers:
        """(k,) for each moving node the row of the plane's moving node to which it belongs."""
        return np.searchsorted(self.model.plane.roles.moving, self.model.layer.front[self.model.moving])

    @cached_property
    def _counts(self) -> Integers:
        """(k',) number of moving nodes that belong to each of the plane's moving nodes."""
        return np.bincount(self._places)
