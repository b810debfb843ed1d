"""The evaluator and judge of a session whose partitions lie on workers.

``MotionModel`` asks it for displacements of all nodes and for the quality of meshes. Questions about fewer points
(boundary nodes, grid points, the surroundings of bad cells) are computed locally. Sent per step:

============== ============================================================ =======================
direction      what                                                         grows as
============== ============================================================ =======================
to workers     coefficients: those that reach the partition                 boundary, and its share
to workers     positions: where boundary and corrected nodes were put       boundary
from workers   displacements of all nodes, since the session answers them   volume
from workers   parts of the summary                                         partitions
============== ============================================================ =======================
"""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.distributed.connection import Connection
from mesh_motion_server.distributed.crew import Crew, Question
from mesh_motion_server.distributed.held import HeldPartition, displace, gradient, judge, questioned
from mesh_motion_server.distributed.order_statistics import BinContent
from mesh_motion_server.distributed.packing import pack
from mesh_motion_server.distributed.split import Split, mesh_digest
from mesh_motion_server.distributed.summaries import Questions, by_question, joined
from mesh_motion_server.distributed.versions import Changed, Version, Versions
from mesh_motion_server.numerics.interpolation.evaluation import LocalEvaluator
from mesh_motion_server.numerics.interpolation.two_scale.interpolant import AnyInterpolant
from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.numerics.mesh.points import bounding_box
from mesh_motion_server.numerics.quality.quality_summary import QualitySummary

__all__ = ["DistributedEvaluator"]

Floats = NDArray[np.float64]

#: A partition with fewer cells is not worth a message.
_LEAST_CELLS = 2000


class DistributedEvaluator:
    """An :class:`~mesh_motion_server.numerics.interpolation.evaluation.Evaluator` and judge of one mesh.

    Its results are those of one machine: displacements and gradients bit for bit, and the quality except for the means.

    Parameters
    ----------
    connection : Connection
    points : (n, d) array, mesh length unit
        Reference coordinates.
    cells : CellTable
    partitions : int, optional
        Default: the number of workers when the mesh is first needed, or fewer for a small mesh.
    """

    def __init__(
        self, connection: Connection, points: Floats, cells: CellTable, *, partitions: int | None = None
    ) -> None:
        self._connection = connection
        self._points = points
        self._cells = cells
        self._partitions = partitions
        self._local = LocalEvaluator()
        self._session = uuid.uuid4().hex[:8]

    @property
    def partitions(self) -> int:
        """Number of partitions."""
        return self._split.count

    def displacement(self, interpolant: AnyInterpolant, points: Floats) -> Floats:
        """(n, k) values at (n, d) points; on the workers where these are the nodes of the mesh.

        Raises
        ------
        ResourceError
            UNAVAILABLE without workers.
        """
        if not self._is_mesh(points) or interpolant.components != points.shape[1]:
            return self._local.displacement(interpolant, points)
        changed = self._versions.changed(points)
        start, moved = self._versions.next(), self._versions.next()
        keep = self._versions.numbers

        def arguments(number: int, fresh: bool) -> tuple[Any, ...]:
            nodes = self._nodes[number]
            packed = pack((interpolant,), changed.box(number, nodes))
            return changed.to(nodes, whole=fresh), start, packed, moved, keep

        answers = self.crew.ask(Question(displace, "coefficients", "displacements", arguments))
        out = np.empty_like(points)
        for number, (own, _) in enumerate(answers):
            out[self._own[number]] = own
        self._versions.know(
            "start", start, self._frozen(changed), [changed.box(n, self._nodes[n]) for n in self._numbers]
        )
        self._versions.know("moved", moved, points + out, [box for _, box in answers])
        return out

    def gradient(self, interpolant: AnyInterpolant, points: Floats) -> Floats:
        """(n, k, d) gradients at (n, d) points; on the workers where these are the nodes of the mesh."""
        if not self._is_mesh(points):
            return self._local.gradient(interpolant, points)
        changed = self._versions.changed(points)

        def arguments(number: int, fresh: bool) -> tuple[Any, ...]:
            nodes = self._nodes[number]
            return changed.to(nodes, whole=fresh), pack((interpolant,), changed.box(number, nodes))

        answers = self.crew.ask(Question(gradient, "coefficients", "displacements", arguments))
        out = np.empty((len(points), interpolant.components, points.shape[1]))
        for number, own in enumerate(answers):
            out[self._own[number]] = own
        return out

    def summary(self, points: Floats, metric: str) -> QualitySummary:
        """Quality of the mesh with its nodes at ``points`` (n, d)."""
        changed = self._versions.changed(points)
        version, keep = self._versions.next(), self._versions.numbers

        def arguments(number: int, fresh: bool) -> tuple[Any, ...]:
            return changed.to(self._nodes[number], whole=fresh), version, metric, keep

        answers = self.crew.ask(Question(judge, "positions", "summaries", arguments))
        self._versions.know("judged", version, self._frozen(changed), [box for _, box in answers])
        return joined([part for part, _ in answers], metric, lambda questions: self._ask(questions, changed, metric))

    def close(self) -> None:
        """Free the partitions on the workers. Idempotent."""
        if "crew" in self.__dict__:
            self.crew.close()

    def _ask(self, questions: Questions, changed: Changed, metric: str) -> list[list[BinContent]]:
        """Return the bins of all partitions, by question; a rebuilt partition is judged again first."""
        version, keep = self._versions.next(), self._versions.numbers

        def arguments(number: int, fresh: bool) -> tuple[Any, ...]:
            where = changed.to(self._nodes[number], whole=True) if fresh else None
            return questions, where, version, metric, keep

        return by_question(self.crew.ask(Question(questioned, "questions", "summaries", arguments)))

    def _is_mesh(self, points: Floats) -> bool:
        return points.shape == self._points.shape

    @staticmethod
    def _frozen(changed: Changed) -> Floats:
        """Return the positions in an array that the caller cannot change."""
        return changed.version.points if not len(changed.rows) else changed.points.copy()

    @cached_property
    def _split(self) -> Split:
        worth = max(len(self._cells) // _LEAST_CELLS, 1)
        count = self._partitions or min(len(self._connection.wait_for_workers()), worth)
        return Split.build(self._points, self._cells, count)

    @property
    def _numbers(self) -> range:
        return range(self._split.count)

    @cached_property
    def crew(self) -> Crew:
        """The partitions on their workers."""
        name = f"mesh-motion-{mesh_digest(self._points, self._cells)[:12]}-{self._session}"
        return Crew(self._connection, name, self._split.count, lambda n: HeldPartition(self._split.partition(n)))

    @cached_property
    def _nodes(self) -> Sequence[NDArray[np.int64]]:
        """Nodes of each partition with its halo, ascending."""
        return [self._split.nodes(number) for number in self._numbers]

    @cached_property
    def _own(self) -> Sequence[NDArray[np.int64]]:
        """Nodes that each partition owns, ascending."""
        return [self._split.own(number) for number in self._numbers]

    @cached_property
    def _versions(self) -> Versions:
        points = self._points.copy() if self._points.flags.writeable else self._points
        return Versions(Version(0, points, tuple(bounding_box(points[nodes]) for nodes in self._nodes)))
