"""A session's model whose partitions lie on workers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.distributed.connection import Connection
from mesh_motion_server.distributed.evaluator import DistributedEvaluator
from mesh_motion_server.distributed.fallback import LocalWhenAlone
from mesh_motion_server.distributed.traffic import Traffic
from mesh_motion_server.numerics.interpolation.factor_source import CacheReport, FactorSource
from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.numerics.mesh.roles import Patch
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.motion.exact_displacements import BoundaryDisplacement
from mesh_motion_server.numerics.motion.motion import MotionModel
from mesh_motion_server.numerics.motion.motion_found import Motion
from mesh_motion_server.numerics.quality.quality_summary import Judgement

__all__ = ["FALLBACKS", "DistributedModel"]

Floats = NDArray[np.float64]

FALLBACKS = ("refuse", "local")
"""What becomes of a motion when no worker answers: an error, after which the session goes on, or computing here."""


@dataclass(frozen=True, eq=False)
class DistributedModel:
    """A :class:`~mesh_motion_server.numerics.motion.motion.MotionModel` that computes on workers.

    Attributes
    ----------
    model : MotionModel
    evaluator : DistributedEvaluator
    connection : Connection
    """

    model: MotionModel
    evaluator: DistributedEvaluator
    connection: Connection

    @classmethod
    def build(
        cls,
        points: Floats,
        cells: CellTable,
        patches: Mapping[str, Patch],
        method: Method,
        *,
        connection: Connection,
        partitions: int | None = None,
        fallback: str = "refuse",
    ) -> DistributedModel:
        """Check the mesh and prepare its motions; nothing is sent to workers yet.

        Parameters
        ----------
        points, cells, patches, method
            As for :meth:`MotionModel.build`.
        connection : Connection
            Used by this model only.
        partitions : int, optional
        fallback : {"refuse", "local"}

        Raises
        ------
        InvalidInput
            As :meth:`MotionModel.build`.
        """
        evaluator = DistributedEvaluator(connection, points, cells, partitions=partitions)
        used = LocalWhenAlone(evaluator, points, cells) if fallback == "local" else evaluator
        model = MotionModel.build(points, cells, patches, method, evaluator=used, judge=used)
        return cls(model, evaluator, connection)

    @property
    def method(self) -> Method:
        """The method with both radii filled in."""
        return self.model.method

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the mesh check."""
        return self.model.warnings

    def without_distributions(self) -> DistributedModel:
        """Return this model: joining the partitions' answers needs their distributions anyway."""
        return self

    def summary(self, points: Floats) -> Judgement:
        """Quality of the mesh with its nodes at ``points`` (n, d)."""
        return self.model.summary(points)

    def move(
        self,
        committed: Floats,
        targets: Floats,
        factors: FactorSource | None = None,
        *,
        boundary_displacement: BoundaryDisplacement | None = None,
    ) -> Motion:
        """As :meth:`MotionModel.move`; its ``caches`` also count the bytes sent and received."""
        before = self.evaluator.crew.traffic.copy()
        motion = self.model.move(committed, targets, factors, boundary_displacement=boundary_displacement)
        return replace(motion, caches=motion.caches | _bytes_of(self.evaluator.crew.traffic.since(before)))

    def close(self) -> None:
        """Free the partitions and disconnect from the cluster. Idempotent."""
        self.evaluator.close()
        self.connection.close()


def _bytes_of(traffic: Traffic) -> CacheReport:
    """Return the bytes of a motion as a reply has them."""
    return {
        "bytes_to_workers": traffic.sent.total(),
        "bytes_from_workers": traffic.received.total(),
        "partitions_rebuilt": traffic.rebuilt,
    }
