"""A Move as a function of values: the computation of a session, which a replay repeats."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.distributed.field import Field
from mesh_motion_numerics.motion.motion_found import BoundaryDisplacement
from mesh_motion_protocol.errors import InvalidInput, QualityRefused

from mesh_motion_server.session.factors import FactorCache
from mesh_motion_server.session.model import Model
from mesh_motion_server.session.partitions.exact_displacements import settle
from mesh_motion_server.session.partitions.meshes import MergedMesh
from mesh_motion_server.session.partitions.numbering import in_senders_numbers, text_in_senders_numbers
from mesh_motion_server.session.state import MoveInput

if TYPE_CHECKING:
    from mesh_motion_numerics.motion.motion_found import Motion


@dataclass(frozen=True, eq=False)
class Computed:
    """A motion, and the coordinates that its answer gives."""

    motion: Motion  # the motion of the numerics
    #: (n, d), mesh length unit. In canonical order, read-only: bitwise the frame's coordinates plus ``displacements``.
    points: Floats
    exact: bool  # whether ``points`` are bitwise the motion's own
    displacements: list[Floats]  # one (n_p, d) array per partition, mesh length unit

    @property
    def field(self) -> Field | None:
        """The displacement as a field, if the client evaluates it."""
        return None if self.motion.field is None else Field.of(self.motion.field)


def compute(
    model: Model,
    mesh: MergedMesh,
    committed: Floats,
    move_input: MoveInput,
    factors: FactorCache,
    *,
    with_displacements: bool = True,
) -> Computed:
    """Compute the motion that a Move requests.

    Raises InvalidInput if a target is not finite. Raises QualityRefused if no acceptable motion was found.

    Parameters
    ----------
    committed : (n, d) array, mesh length unit
        In canonical order.
    with_displacements : bool
        Whether the displacements are also needed.
    """
    base = mesh.points if move_input.frame == "reference" else committed
    moving = mesh.moving
    boundary = BoundaryDisplacement(base.take(moving, axis=0), move_input.boundary_displacement)
    targets = boundary.origin + boundary.displacement
    _check_places(targets, mesh)
    try:
        motion = model.move(committed, targets, factors, boundary_displacement=boundary)
    except (InvalidInput, QualityRefused) as error:
        raise in_senders_numbers(error, mesh) from error
    warnings = [text_in_senders_numbers(warning, mesh) for warning in motion.warnings]
    if warnings != motion.warnings:
        motion = replace(motion, warnings=warnings)
    displacements = mesh.scatter_differences(motion.points, base, boundary.displacement) if with_displacements else []
    points = _own(motion.points, committed, mesh.points)
    exact = settle(points, base, moving, boundary.displacement)
    points.flags.writeable = False
    return Computed(motion, points, exact, displacements)


def _own(points: Floats, *kept: Floats) -> Floats:
    """Return a motion's coordinates (n, d) for writing; copy them if others share them."""
    shared = any(np.may_share_memory(points, other) for other in kept)
    return points.copy() if shared or not points.flags.writeable else points


def _check_places(targets: Floats, mesh: MergedMesh) -> None:
    """Check that the target places (k, d) of the moving nodes are finite."""
    lost = np.flatnonzero(~np.isfinite(targets).all(axis=1))
    if len(lost):
        partition, node = mesh.locate_node(int(mesh.moving[lost[0]]))
        raise InvalidInput(
            f"partition {partition}, node {node}: its displacement exceeds the floating-point range",
            code="INVALID_ARGUMENT.NONFINITE",
            details={"partition": partition, "node": node},
        )
