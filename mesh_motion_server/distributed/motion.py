"""Motions of a mesh that no single machine holds: the interpolation is solved for here, everything else on the workers.

Here are the boundary nodes alone. Each step the coefficients go to the workers, which move their nodes, put boundary
nodes at their targets, judge their cells, and answer with their part of the summary: nothing as large as the
mesh travels or is kept in one place. Whoever owns a partition (a rank of a solver) fetches its positions.

A partition that is rebuilt starts from the reference mesh and repeats the committed steps; from every so many on, it
starts from a checkpoint, which the workers write to a folder that they share.
"""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.distributed.connection import Connection
from mesh_motion_server.distributed.crew import Crew, Question
from mesh_motion_server.distributed.held import Positions, Step, advance, own_positions, questioned, write_positions
from mesh_motion_server.distributed.order_statistics import BinContent
from mesh_motion_server.distributed.packing import pack
from mesh_motion_server.distributed.sources import PartitionSource
from mesh_motion_server.distributed.summaries import Questions, by_question, joined
from mesh_motion_server.distributed.traffic import Traffic
from mesh_motion_server.errors import InvalidInput, SessionError
from mesh_motion_server.numerics.interpolation.evaluation import LocalEvaluator
from mesh_motion_server.numerics.interpolation.factor_source import FactorSource, MakeEachTime
from mesh_motion_server.numerics.interpolation.support_radius import suggest_support_radius
from mesh_motion_server.numerics.interpolation.two_scale.plans import TwoScalePlans
from mesh_motion_server.numerics.mesh.roles import BoundaryRoles, Patch
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.motion.acceptance import refuse_unacceptable
from mesh_motion_server.numerics.motion.motion_field import Stage
from mesh_motion_server.numerics.motion.standard_motion import StandardMotion
from mesh_motion_server.numerics.quality.quality_summary import QualitySummary
from mesh_motion_server.numerics.stopwatch import Stopwatch

__all__ = ["PartitionedMotion", "PartitionedTrial"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Committed steps that a rebuilt partition repeats at most.
_HISTORY = 64

#: What needs more of the mesh than its boundary.
_FIXED_CHOICES = {
    "correction": ("none",),
    "displacement": ("relative", "absolute"),
    "reduction": ("none",),
    "boundary_layer_thickness": (None,),
}


@dataclass(frozen=True, eq=False)
class PartitionedTrial:
    """A motion that was computed and judged, and not yet committed.

    Attributes
    ----------
    summary : QualitySummary
        Of the whole mesh.
    seconds : dict
        Wall time of ``solve`` (here), ``displace`` (moving and judging on the workers), ``predict`` (joining what they
        say), and their ``total``.
    """

    summary: QualitySummary
    seconds: dict[str, float]
    version: int
    step: _Stored
    boundary: Floats
    boxes: tuple[Floats, ...]


@dataclass(frozen=True, eq=False)
class _Stored:
    """A step as it is kept for partitions that are rebuilt: O(boundary) bytes."""

    stage: Stage
    boundary: Floats
    boxes: tuple[Floats, ...]


@dataclass(frozen=True, eq=False)
class _State:
    """The committed state: where to start when a partition is rebuilt, and by which steps it goes on."""

    version: int
    boundary: Floats
    boxes: tuple[Floats, ...]
    checkpoint: str
    steps: tuple[_Stored, ...]


class PartitionedMotion:
    """A session with partitions on workers and the boundary here.

    Parameters
    ----------
    source : PartitionSource
    patches : mapping of str to Patch
        With nodes of the whole mesh; roles "moving" and "fixed".
    method : Method
        With ``correction = "none"``: a correction needs the cells in one place.
    connection : Connection
    checkpoints : Path, optional
        A folder that all workers and this process share; without one a rebuilt partition repeats every step.

    Raises
    ------
    InvalidInput
        If the method or a role needs the mesh in one place.
    """

    def __init__(
        self,
        source: PartitionSource,
        patches: Mapping[str, Patch],
        method: Method,
        connection: Connection,
        *,
        checkpoints: Path | None = None,
    ) -> None:
        _check(method, patches)
        roles = _numbered(BoundaryRoles.from_patches(patches), source.nodes)
        radius = method.support_radius or suggest_support_radius(source.points, roles)
        self.method = replace(method, support_radius=radius, enrichment_radius=method.enrichment_radius or radius)
        plain = StandardMotion(
            source.points, roles, self.method, None, None, 0.0, TwoScalePlans(()), LocalEvaluator(), None
        )
        self._motion = plain.with_layer(None)
        self._source = source
        self._checkpoints = checkpoints
        self._session = uuid.uuid4().hex[:8]
        name = f"mesh-motion-{source.name[:12]}-{self._session}"
        self._crew = Crew(connection, name, len(source.shares), source.make)
        boxes = tuple(share.box for share in source.shares)
        self._now = _State(0, source.points, boxes, "", ())
        self._version = 0
        self._trial: PartitionedTrial | None = None

    @property
    def roles(self) -> BoundaryRoles:
        """Which boundary nodes (of ``source.nodes``) move and which do not."""
        return self._motion.roles

    @property
    def boundary(self) -> Floats:
        """(b, d) committed positions of the boundary nodes, mesh length unit."""
        return self._now.boundary

    @property
    def traffic(self) -> Traffic:
        """Bytes so far."""
        return self._crew.traffic

    @property
    def worker_seconds(self) -> float:
        """Processor time of all workers so far."""
        return self._crew.seconds

    @property
    def longest_seconds(self) -> float:
        """Processor time of the busiest worker in each question so far, added up."""
        return self._crew.longest_seconds

    def move(self, targets: Floats, factors: FactorSource | None = None) -> PartitionedTrial:
        """Move the moving nodes to ``targets`` (k, d); a trial until :meth:`commit`.

        Raises
        ------
        NumericalError
            If it inverts cells, or where asked, if it stays below the threshold; an earlier trial stays.
        ResourceError
            UNAVAILABLE without workers.
        """
        watch = Stopwatch()
        factors = MakeEachTime() if factors is None else factors
        found = self._motion.trial(self._now.boundary, targets, factors, watch)
        with watch.phase("displace"):
            absolute = self.method.displacement == "absolute"
            boxes = tuple(share.box for share in self._source.shares) if absolute else self._now.boxes
            step = _Stored(found.field.stages[0], found.points, boxes)
            self._version += 1
            question = self._question(step, self._version)
            answers = self._crew.ask(question)
        with watch.phase("predict"):
            parts, metric = [part for part, _ in answers], self.method.quality_metric
            summary = joined(parts, metric, lambda questions: self._ask(questions, question))
        refuse_unacceptable(self.method, summary, summary.metric.min >= self.method.quality_threshold)
        after = tuple(box for _, box in answers)
        self._trial = PartitionedTrial(summary, watch.seconds(), self._version, step, found.points, after)
        return self._trial

    def commit(self) -> None:
        """Make the trial the committed state.

        Raises
        ------
        SessionError
            Without a trial.
        """
        trial, self._trial = self._trial, None
        if trial is None:
            raise SessionError("there is no trial to commit", hint="move first")
        before = () if self.method.displacement == "absolute" else self._now.steps
        steps = (*before, trial.step)
        self._now = _State(trial.version, trial.boundary, trial.boxes, self._now.checkpoint, steps)
        if self._checkpoints is not None and len(steps) >= _HISTORY:
            self._write_checkpoint(self._checkpoints)

    def positions(self) -> list[Floats]:
        """(o, d) committed positions of each partition's own nodes: as much as the mesh, for whoever wants it here."""
        question = Question(own_positions, "questions", "displacements", self._committed)
        answers: list[Floats] = self._crew.ask(question)
        return answers

    def close(self) -> None:
        """Free the partitions on the workers. Idempotent."""
        self._crew.close()

    # --- what workers are asked --------------------------------------------------------------------------------------

    def _question(self, step: _Stored, version: int) -> Question:
        keep = tuple({self._now.version, version})
        relative = self.method.displacement == "relative"

        def arguments(number: int, fresh: bool) -> tuple[Any, ...]:
            start, steps = self._committed(number, fresh) if relative else (Positions(0), ())
            return start, (*steps, self._sent(step, number)), version, self.method.quality_metric, keep

        return Question(advance, "coefficients", "summaries", arguments)

    def _ask(self, questions: Questions, question: Question) -> list[list[BinContent]]:
        """Bins of all partitions, by question; one that was rebuilt repeats the step first."""

        def arguments(number: int, fresh: bool) -> tuple[Any, ...]:
            return questions, question.arguments(number, fresh) if fresh else None

        return by_question(self._crew.ask(Question(questioned_after, "questions", "summaries", arguments)))

    def _committed(self, number: int, fresh: bool) -> tuple[Positions, tuple[Step, ...]]:
        """The committed positions of a partition: a version it has, or all that leads to it."""
        if not fresh:
            return Positions(self._now.version), ()
        checkpoint = self._now.checkpoint
        start = Positions(None, file=checkpoint.format(number)) if checkpoint else Positions(0)
        return start, tuple(self._sent(step, number) for step in self._now.steps)

    def _sent(self, step: _Stored, number: int) -> Step:
        """A step for one partition."""
        share, stage = self._source.shares[number], step.stage
        packed = pack((stage.interpolant, *stage.further), step.boxes[number])
        return Step(stage.rigid, packed, share.rows, step.boundary[share.places])

    def _write_checkpoint(self, folder: Path) -> None:
        """Have the committed positions written, and forget the steps that led there."""
        pattern = str(folder.resolve() / f"{self._session}-{self._now.version}-{{:05d}}.npy")
        old = self._now.checkpoint

        def arguments(number: int, fresh: bool) -> tuple[Any, ...]:
            return (*self._committed(number, fresh), pattern.format(number))

        self._crew.ask(Question(write_positions, "questions", "summaries", arguments))
        self._now = replace(self._now, checkpoint=pattern, steps=())
        for number in range(self._crew.count if old else 0):
            Path(old.format(number)).unlink(missing_ok=True)


def questioned_after(held: Any, questions: Questions, repeated: tuple[Any, ...] | None) -> tuple[BinContent, ...]:
    """As :func:`~mesh_motion_server.distributed.held.questioned`, after a step that is ``repeated``."""
    if repeated is not None:
        advance(held, *repeated)
    return questioned(held, questions, None, 0, "", ())


def _check(method: Method, patches: Mapping[str, Patch]) -> None:
    """Raise InvalidInput for what needs the mesh in one place."""
    for name, allowed in _FIXED_CHOICES.items():
        if getattr(method, name) not in allowed:
            expected = " or ".join(map(repr, allowed))
            raise InvalidInput(
                f"a mesh that no machine holds is moved with {name} = {expected}, got {getattr(method, name)!r}",
                hint="a session of a server with --distributed takes every method",
            )
    for name, patch in patches.items():
        if patch.role not in ("moving", "fixed"):
            raise InvalidInput(
                f"patch {name!r}: expected a role moving or fixed, got {patch.role!r}",
                hint="a session of a server with --distributed takes every role",
            )


def _numbered(roles: BoundaryRoles, nodes: Ints) -> BoundaryRoles:
    """The roles in the numbers of the boundary nodes (b,), ascending."""
    known = np.isin(roles.all, nodes)
    if not known.all():
        raise InvalidInput(
            f"node {roles.all[~known][0]} has a role and is not among the source's boundary nodes",
            hint="give the source every node of a patch",
        )
    moving, fixed = np.searchsorted(nodes, roles.moving), np.searchsorted(nodes, roles.fixed)
    if len(moving) + len(fixed) != len(nodes):
        raise InvalidInput(
            f"the source has {len(nodes)} boundary nodes, {len(moving) + len(fixed)} of them have a role",
            hint="give the source the nodes of these patches only",
        )
    return BoundaryRoles(moving, fixed, roles.sliding, roles.periodic)
