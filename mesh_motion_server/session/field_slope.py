"""The derivative of a motion whose volume is with the client: the messages have derivatives of the field.

For a tangent, the client evaluates the field at its own nodes; for the nodes of the corrected region it takes the
velocities from the server. For a cotangent, the client sends the derivatives by the field's coefficients, without the
region's nodes: the weights of these nodes pass through the correction first.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.distributed.field import Field
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.session.partitions.meshes import MergedMesh
from mesh_motion_server.session.partitions.regions import Rows

if TYPE_CHECKING:  # imported only here: other sessions do not need it, and it is large
    from mesh_motion_numerics.correction.smooth_slope import SmoothSlope
    from mesh_motion_numerics.interpolation.factor_source import FactorSource
    from mesh_motion_numerics.interpolation.interpolation_map import FieldMap
    from mesh_motion_numerics.motion.boundary_motion import BoundaryMotion
    from mesh_motion_numerics.motion.motion_slope import PlainSlope

    from mesh_motion_server.session.corrections import CorrectedRegion
    from mesh_motion_server.session.partitions.regions import MergedRegion


@dataclass(frozen=True, eq=False)
class FieldTangent:
    """Velocities, the components of c vectors one after the other."""

    velocity: Floats  # (n, c d). Velocities of the uploaded nodes, in canonical order
    coefficients: Floats  # (r, c d). Coefficients of the velocity field
    freed: Integers  # (f,). Global ids of the nodes that the correction frees
    of_freed: Floats  # (f, c d)


@dataclass(frozen=True, eq=False)
class FieldCotangent:
    """Weights, the components of c vectors one after the other."""

    weights: Floats  # (n, c d). Weights of the uploaded nodes, in canonical order
    #: (r, c d). Derivatives by the coefficients from the client's other nodes, without the nodes with ``ids``.
    coefficients: Floats
    ids: Integers  # (q,). Global ids of nodes of the region, once for each partition that has them
    of_ids: Floats  # (q, c d)


@dataclass(frozen=True, eq=False)
class FieldSlope:
    """The derivative at one state."""

    mesh: MergedMesh
    model: BoundaryMotion
    field: Field  # a field of the reference mesh: all other fields differ only in their coefficients
    points: Floats  # (n, d), mesh length unit. Coordinates of the uploaded nodes before the correction
    corrected: CorrectedRegion | None  # none without a correction
    factors: FactorSource

    def tangent(self, velocity: Floats) -> FieldTangent:
        """The tangent for one vector (k, d) of the moving nodes."""
        plain, rows = self._plain, np.zeros_like(self.mesh.points)
        rows[self.model.motion.roles.moving] = velocity
        for step in plain.steps:
            step.apply(rows)
        interpolant = self._map.interpolant(rows[plain.interpolated.controls])
        free = self._unknown
        rows[free] = evaluation.displacement(interpolant, self.mesh.points[free])
        plain.tied.apply(rows)
        coefficients = Field.of(interpolant).coefficients
        if self._smooth is None or self._smooth.region is None:
            return FieldTangent(rows, coefficients, np.empty(0, dtype=np.int64), rows[:0])
        region = self._region
        of_region = np.empty_like(region.points)
        here, there, inside = self._shared
        of_region[here] = rows[there]
        of_region[inside] = evaluation.displacement(interpolant, region.points[inside])
        freed = self._smooth.region.free.free
        return FieldTangent(rows, coefficients, region.ids[freed], self._smooth.apply(of_region)[freed])

    def cotangent(self, given: FieldCotangent) -> Floats:
        """(k, d) weights of the moving nodes, for one vector."""
        plain, rows, d = self._plain, given.weights.copy(), self.mesh.points.shape[1]
        places, counted = [np.empty((0, d))], [np.empty((0, d))]
        if self._smooth is None:
            _refuse_strange(given.ids)
        else:
            region = self._region
            here, there, inside = self._shared
            weights = np.zeros_like(region.points)
            weights[here] = rows[there]
            np.add.at(weights, self._rows_of(given.ids), given.of_ids)
            weights, _ = self._smooth.transpose(weights)
            rows[there] = weights[here]
            places.append(region.points[inside])
            counted.append(weights[inside])
        plain.tied.transpose(rows)
        free = self._unknown
        places.append(self.mesh.points[free])
        counted.append(rows[free])
        total = given.coefficients + self.field.counted(np.concatenate(places), np.concatenate(counted))
        rows[free] = 0.0
        rows[plain.interpolated.controls] += self._map.transpose(*self.field.split(total))
        for step in reversed(plain.steps):
            step.transpose(rows)
        return rows[self.model.motion.roles.moving]

    @cached_property
    def _map(self) -> FieldMap:
        return self.model.field_map(self.factors)

    @cached_property
    def _plain(self) -> PlainSlope:
        """Derivative of the motion of the uploaded nodes, without the correction."""
        return self.model.plain_slope(self.points, self.factors)

    @cached_property
    def _unknown(self) -> Integers:
        """Rows of the uploaded nodes that the field moves."""
        return np.setdiff1d(np.arange(len(self.points)), self._plain.known)

    # --- the corrected region ----------------------------------------------------------------------------------------

    @cached_property
    def _smooth(self) -> SmoothSlope | None:
        """The correction's derivative; None if no cell was sent."""
        # imported here, because other sessions do not need it
        from mesh_motion_numerics.correction.smooth_slope import SmoothSlope, not_at_minimum  # noqa: PLC0415

        if self.corrected is None or self.corrected.region is None:
            return None
        if not self.corrected.smooth:
            raise not_at_minimum()
        region = self.corrected.region
        mesh = region.points, region.cells, region.held, region.elsewhere
        smooth = self.model.smooth(*mesh, self.corrected.n_nodes, region.rows)
        return SmoothSlope.build(smooth, region.positions, self.corrected.points)

    @property
    def _region(self) -> MergedRegion:
        assert self.corrected is not None
        assert self.corrected.region is not None
        return self.corrected.region

    @cached_property
    def _shared(self) -> tuple[Integers, Integers, Integers]:
        """Rows of the uploaded nodes in the region, their rows in the mesh, and the region's other rows."""
        rows = self._region.rows
        here = np.flatnonzero(rows >= 0)
        return here, rows[here], np.flatnonzero(rows < 0)

    def _rows_of(self, ids: Integers) -> Integers:
        """Rows (q,) of the region of nodes that are not uploaded.

        Raises InvalidInput if a node is not in the region.
        """
        region = self._region
        _refuse_strange(ids[~np.isin(ids, region.ids[self._shared[2]])])
        return Rows(region.ids)(ids)


def _refuse_strange(ids: Integers) -> None:
    """Raise if there are unknown nodes with these global ids (k,)."""
    if len(ids):
        raise InvalidInput(
            f"region: the node with global id {ids[0]} is not in the corrected region, or was uploaded",
            code="INVALID_ARGUMENT.VALUE",
            hint="name the nodes of the last CORRECT that were not uploaded",
            details={"node": int(ids[0])},
        )
