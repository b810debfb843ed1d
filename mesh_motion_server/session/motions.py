"""A Move as a function of values: what a session computes when it is asked, and once more when it is replayed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.motion.exact_displacements import settle
from mesh_motion_server.session.factors import FactorCache
from mesh_motion_server.session.model import Model
from mesh_motion_server.session.partitions.meshes import MergedMesh
from mesh_motion_server.session.partitions.numbering import in_senders_numbers
from mesh_motion_server.session.state import Origin

__all__ = ["Computed", "compute"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Computed:
    """A motion, and the coordinates that its answer leads to.

    Attributes
    ----------
    motion : Motion
        Of the numerics.
    points : (n, d) array, mesh length unit
        In canonical order, read-only: bitwise the frame's coordinates plus ``displacements``.
    exact : bool
        Whether these are bitwise the motion's own.
    displacements : one (n_p, d) array per partition, mesh length unit
    """

    motion: Any
    points: Floats
    exact: bool
    displacements: list[Floats]


def compute(
    model: Model, mesh: MergedMesh, committed: Floats, origin: Origin, factors: FactorCache, *, told_apart: bool = True
) -> Computed:
    """The motion that an origin asks for.

    Parameters
    ----------
    committed : (n, d) array, mesh length unit
        In canonical order.
    told_apart : bool
        Whether the displacements are wanted.

    Raises
    ------
    InvalidInput
        If a target is not finite.
    NumericalError
        If no acceptable motion was found.
    """
    base = mesh.points if origin.frame == "reference" else committed
    moving = mesh.moving
    targets = base[moving] + origin.told
    _check_places(targets, mesh)
    try:
        motion = model.move(committed, targets, factors, sent=(base[moving], origin.told))
    except InvalidInput as error:
        raise in_senders_numbers(error, mesh) from error
    displacements = mesh.scatter_differences(motion.points, base, origin.told) if told_apart else []
    points = _own(motion.points, committed, mesh.points)
    exact = settle(points, base, moving, origin.told)
    points.flags.writeable = False
    return Computed(motion, points, exact, displacements)


def _own(points: Floats, *kept: Floats) -> Floats:
    """A motion's coordinates (n, d) to be changed: nobody needs them any more, unless they are others' too."""
    shared = any(np.may_share_memory(points, other) for other in kept)
    return points.copy() if shared or not points.flags.writeable else points


def _check_places(targets: Floats, mesh: MergedMesh) -> None:
    """Places (k, d) of the moving nodes are finite, where base and displacement are."""
    lost = np.flatnonzero(~np.isfinite(targets).all(axis=1))
    if len(lost):
        partition, node = mesh.locate_node(int(mesh.moving[lost[0]]))
        raise InvalidInput(
            f"partition {partition}, node {node}: its displacement leads out of the floating-point range",
            code="INVALID_ARGUMENT.NONFINITE",
            details={"partition": partition, "node": node},
        )
