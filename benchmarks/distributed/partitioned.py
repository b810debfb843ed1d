"""Steps of a mesh that no single process holds: the interpolation is solved for here, the workers do everything else.

This process has the boundary nodes only. In each step the coefficients go to the workers. They move their nodes, put
boundary nodes at their targets, judge their cells, and answer with their part of the summary: nothing as large as the
mesh travels. What a session cannot do without the volume (corrections, sliding nodes, a lost worker's partition made
again) is not here: this measures what a step costs.
"""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.distributed.sources import FileSource
from mesh_motion_server.distributed.connection import Connection
from mesh_motion_server.distributed.crew import Crew, Question
from mesh_motion_server.distributed.held import HeldPartition, Positions, judge, questioned
from mesh_motion_server.distributed.order_statistics import BinContent
from mesh_motion_server.distributed.packing import pack, unpack
from mesh_motion_server.distributed.summaries import PartialSummary, Questions, by_question, joined
from mesh_motion_server.errors import ResourceError
from mesh_motion_server.numerics.interpolation.evaluation import LocalEvaluator
from mesh_motion_server.numerics.interpolation.factor_source import FactorSource
from mesh_motion_server.numerics.interpolation.support_radius import suggest_support_radius
from mesh_motion_server.numerics.interpolation.two_scale.plans import TwoScalePlans
from mesh_motion_server.numerics.mesh.paths import RigidMotion
from mesh_motion_server.numerics.mesh.roles import BoundaryRoles, Patch
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.motion.stage import Stage
from mesh_motion_server.numerics.motion.standard_motion import StandardMotion
from mesh_motion_server.numerics.quality.quality_summary import QualitySummary
from mesh_motion_server.numerics.stopwatch import Stopwatch

__all__ = ["PartitionedMotion", "PartitionedStep"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class SentStage:
    """One stage of a motion as it travels to one partition.

    Attributes
    ----------
    rigid : RigidMotion or None
    interpolants : bytes
        The levels, from :func:`~mesh_motion_server.distributed.packing.pack`.
    rows : (k,) int64 array
        Nodes with prescribed positions, as rows of the partition.
    values : (k, d) array, mesh length unit
    """

    rigid: RigidMotion | None
    interpolants: bytes
    rows: Ints
    values: Floats

    def positions(self, points: Floats) -> Floats:
        """(p, d) where the stage puts points (p, d)."""
        first, *further = unpack(self.interpolants)
        moved = Stage(self.rigid, first, tuple(further)).positions(points, LocalEvaluator())
        moved[self.rows] = self.values
        return moved


@dataclass(frozen=True, eq=False)
class PartitionedStep:
    """A step that was computed and judged, and is the committed state now.

    Attributes
    ----------
    summary : QualitySummary
        Of the whole mesh.
    stage : Stage
        The interpolants that were solved for.
    boxes : tuple of (2, d) array, mesh length unit
        Of each partition before the step.
    """

    summary: QualitySummary
    stage: Stage
    boxes: tuple[Floats, ...]


class PartitionedMotion:
    """The boundary here, the partitions on workers.

    Parameters
    ----------
    source : FileSource
    patches : mapping of str to Patch
        With nodes of the whole mesh; roles "moving" and "fixed".
    method : Method
        With ``correction = "none"`` and ``displacement = "relative"``.
    connection : Connection
    """

    def __init__(
        self, source: FileSource, patches: Mapping[str, Patch], method: Method, connection: Connection
    ) -> None:
        of_mesh = BoundaryRoles.from_patches(patches)
        moving, fixed = (np.searchsorted(source.nodes, nodes) for nodes in (of_mesh.moving, of_mesh.fixed))
        self.roles = BoundaryRoles(moving, fixed, of_mesh.sliding, of_mesh.periodic)
        radius = method.support_radius or suggest_support_radius(source.points, self.roles)
        self.method = replace(method, support_radius=radius, enrichment_radius=method.enrichment_radius or radius)
        plain = StandardMotion(
            source.points, self.roles, self.method, None, None, 0.0, TwoScalePlans(()), LocalEvaluator(), None
        )
        self.interpolation = plain.with_layer(None)
        self.boundary = source.points
        self._source = source
        self._boxes = tuple(share.box for share in source.shares)
        self._version = 0
        name = f"mesh-motion-{source.name[:12]}-{uuid.uuid4().hex[:8]}"
        self.crew = Crew(connection, name, len(source.shares), source.make)

    def move(self, targets: Floats, factors: FactorSource) -> PartitionedStep:
        """Move the moving nodes to ``targets`` (k, d) and commit that.

        Raises
        ------
        ResourceError
            UNAVAILABLE without workers, or when one is lost after the first step.
        """
        found = self.interpolation.trial(self.boundary, targets, factors, Stopwatch())
        stage, before, metric = found.stages[0], self._boxes, self.method.quality_metric
        start, version = self._version, self._version + 1

        def arguments(number: int, fresh: bool) -> tuple[Any, ...]:
            if fresh and start:
                raise ResourceError("a worker was lost with the positions of its partition", code="UNAVAILABLE")
            share = self._source.shares[number]
            packed = pack((stage.interpolant, *stage.further), before[number])
            sent = SentStage(stage.rigid, packed, share.rows, found.points[share.places])
            return Positions(start), sent, version, metric

        answers = self.crew.ask(Question(advance, "coefficients", "summaries", arguments))
        summary = joined([part for part, _ in answers], metric, self._ask)
        self.boundary, self._version = found.points, version
        self._boxes = tuple(box for _, box in answers)
        return PartitionedStep(summary, stage, before)

    def positions(self) -> list[Floats]:
        """(o, d) positions of each partition's own nodes: as much as the mesh, to compare it."""
        where = Positions(self._version)
        answers: list[Floats] = self.crew.ask(
            Question(own_positions, "questions", "displacements", lambda _number, _fresh: (where,))
        )
        return answers

    def close(self) -> None:
        """Free the partitions on the workers. Idempotent."""
        self.crew.close()

    def _ask(self, questions: Questions) -> list[list[BinContent]]:
        """Bins of all partitions, by question."""

        def arguments(_number: int, _fresh: bool) -> tuple[Any, ...]:
            return questions, None, 0, "", ()

        return by_question(self.crew.ask(Question(questioned, "questions", "summaries", arguments)))


def advance(
    held: HeldPartition, start: Positions, stage: SentStage, version: int, metric: str
) -> tuple[PartialSummary, Floats]:
    """On a worker: judge the cells where the stage takes the nodes, and keep that as a version."""
    return judge(held, Positions(None, None, stage.positions(held.at(start))), version, metric, ())


def own_positions(held: HeldPartition, where: Positions) -> Floats:
    """On a worker: (o, d) positions of its own nodes, mesh length unit."""
    return held.at(where)[held.mesh.own]
