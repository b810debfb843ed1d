"""Values that a session replaces as a whole, and the results of its operations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.distributed.field import Field, FieldPart
from mesh_motion_numerics.distributed.region import Extent
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.finite_volume import FaceMeasures, face_measures
from mesh_motion_numerics.mesh.points import bounding_box
from mesh_motion_numerics.motion.time_levels import TimeLevel
from mesh_motion_numerics.quality.orientation import OrientedCells, oriented

from mesh_motion_server.session.journal.keeper import Keeper
from mesh_motion_server.session.model import Model
from mesh_motion_server.session.partitions.meshes import MergedMesh
from mesh_motion_server.session.state import CommittedState, State, Trial

if TYPE_CHECKING:
    from mesh_motion_numerics.correction.correction import Correction
    from mesh_motion_numerics.motion.motion_found import Motion
    from mesh_motion_numerics.quality.quality_summary import Judgement, QualitySummary


@dataclass(frozen=True)
class CurrentState:
    """The state of a session; swapped as a whole.

    ``trial_lost``: a trial may have been dropped without a request.
    ``disk_failure_reported``: a reply or the log named it.
    """

    state: State
    committed: CommittedState | None = None
    trial: Trial | None = None
    trial_lost: bool = False
    disk_failure_reported: bool = False


@dataclass(frozen=True, eq=False)
class Built:
    """The values that BUILD makes and that stay constant, and the keeper of the commits.

    ``field``: the field of the reference mesh, if the client evaluates it; all other fields differ only in their
    coefficients.
    """

    mesh: MergedMesh
    model: Model
    keeper: Keeper
    field: Field | None = None

    @cached_property
    def field_parts(self) -> list[FieldPart]:
        """The parts of fields that each partition needs, if the client evaluates them; a single one gets everything."""
        if self.field is None:
            return []
        points, node_maps = self.mesh.points, self.mesh.node_maps
        if len(node_maps) == 1:
            return [FieldPart.whole(self.field)]
        held = [points[own] if len(own) else points[:1] for own in node_maps]
        return [self.field.part(bounding_box(own)) for own in held]

    @cached_property
    def faces(self) -> FaceMeasures | None:
        """Face measures of the reference mesh; computed at the first use."""
        return self.faces_at(self.mesh.points)

    def faces_at(self, points: Floats) -> FaceMeasures | None:
        """Face measures of the mesh with its nodes at ``points`` (n, d), with the cells in the model's orientation."""
        return face_measures(points, self._oriented.cells, self.mesh.points)

    @cached_property
    def listed_cells(self) -> tuple[CellTable, list[Floats]]:
        """The cells as uploaded, and for each cell (m,) of a block 1, or -1 if it had the opposite orientation."""
        signs = np.ones(len(self.mesh.cells))
        signs[self._oriented.mirrored] = -1.0
        return self.mesh.cells, np.split(signs, self.mesh.cells.offsets[1:-1])

    @cached_property
    def _oriented(self) -> OrientedCells:
        return oriented(self.mesh.points, self.mesh.cells)


@dataclass(frozen=True, eq=False)
class MoveOutcome:
    """The result of a Move."""

    step: int
    iteration: int
    motion: Motion  # the motion of the numerics
    #: one (n_p, d) array per partition, mesh length unit. Displacements of all its nodes, in its own order and in the
    #: frame of the request.
    displacements: list[Floats]
    #: Measures of the reference mesh and of the trial; empty if they were not requested, and in one dimension.
    faces: tuple[FaceMeasures, ...] = ()
    field: Field | None = None  # the displacement from the reference mesh, if the client evaluates it
    #: (n, d), mesh length unit per second. Velocities of all nodes, if requested.
    velocity: Floats | None = None


@dataclass(frozen=True)
class VelocityAsked:
    """The velocities that a Move requests in addition to displacements."""

    scheme: str  # {"tangent", "bdf1", "bdf2", "bossak"}
    time: float | None = None  # time of the step, seconds
    boundary: Sequence[Floats] = ()  # one (k_p, d) array per partition. With "tangent": velocities of its moving nodes


@dataclass(frozen=True, eq=False)
class CommitOutcome:
    """The result of a Commit, which becomes durable at once or later."""

    #: step, durable_step: the step of the commit, and the last step that survives a power loss after the answer
    step: int
    durable_step: int
    digest: bytes  # state digest, see :mod:`mesh_motion_protocol.digests`
    quality: Judgement  # quality of the committed coordinates
    #: corrected, level: as in :class:`.state.CommittedState`
    corrected: bool = False
    level: TimeLevel = field(default_factory=TimeLevel)


@dataclass(frozen=True, eq=False)
class Verdict:
    """The result of a Judge."""

    standard: QualitySummary  # quality of the mesh before its correction
    extent: Extent | None  # the region that must be corrected first
    warnings: list[str] = field(default_factory=list)
    correction: Correction | None = None  # the correction that was already done
