"""The position of a session: its state, its steps and its mesh, and the requests that are allowed in it."""

from dataclasses import replace
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.distributed.field import Field
from mesh_motion_numerics.distributed.region import Extent
from mesh_motion_protocol.errors import InvalidInput, SessionError

from mesh_motion_server.session.corrections import first_extent
from mesh_motion_server.session.journal.ledger import Commit
from mesh_motion_server.session.model import Model, checked_warnings
from mesh_motion_server.session.partitions.meshes import MergedMesh
from mesh_motion_server.session.spec import StoredSpec
from mesh_motion_server.session.state import CommittedState, Operation, State, Trial, admit
from mesh_motion_server.session.values import Built, CurrentState

WRITING = (State.READY, State.TRIAL, State.SUSPENDED)
"""States that become FROZEN when the disk fails in the background."""
_STEPS = 1e-30, 1e30
"""Smallest and largest time step, seconds: accelerations of others overflow."""


class Position:
    """The state of a session, and the conditions of its operations.

    Attributes
    ----------
    spec : StoredSpec
        The values that OPEN fixed.
    """

    def __init__(self, spec: StoredSpec) -> None:
        self.spec = spec
        self._reopened = False
        self._now = CurrentState(State.NEW)
        self._built: Built | None = None
        self._epoch = 1

    @property
    def state(self) -> State:
        """A state of the session table."""
        # the disk may have failed in the background since the last request
        failed = self._built is not None and self._built.keeper.frozen and self._now.state in WRITING
        return State.FROZEN if failed else self._now.state

    @property
    def epoch(self) -> int:
        """The epoch, which each RESUME raises."""
        return self._epoch

    @property
    def step(self) -> int:
        """The last committed step."""
        return self._now.committed.step if self._now.committed else 0

    @property
    def durable_step(self) -> int:
        """The last step that survives a power loss."""
        return self._built.keeper.durable_step if self._built else 0

    @property
    def iteration(self) -> int:
        """Number of moves of the open trial, 0 without a trial."""
        return self._now.trial.iteration if self._now.trial else 0

    @property
    def is_built(self) -> bool:
        """Whether there is a mesh."""
        return self._built is not None

    @property
    def mesh(self) -> MergedMesh:
        """The mesh, after BUILD."""
        return self._require_built().mesh

    @property
    def model(self) -> Model:
        """The numerics' model of the mesh, after BUILD."""
        return self._require_built().model

    @property
    def commits(self) -> tuple[Commit, ...]:
        """The latest commits, with their answers."""
        return self._built.keeper.commits if self._built else ()

    def admit(self, operation: Operation) -> State:
        """The state after ``operation``.

        Raises SessionError according to the state table; ABORTED.TRIAL_LOST for a Judge or a Commit whose trial a
        restart dropped; also for a Commit of a trial that the client evaluates but has not judged.
        """
        needs_trial = operation in (Operation.JUDGE, Operation.CORRECT, Operation.COMMIT)
        if needs_trial:
            self.refuse_lost_trial()
        trial = self._now.trial
        if operation is Operation.COMMIT and trial is not None and trial.coefficients is not None and not trial.quality:
            raise SessionError(
                "the trial is not judged, or it was refused", hint="send JUDGE from every partition, or another MOVE"
            )
        try:
            return admit(self.state, operation)
        except SessionError:
            if self.state is State.FROZEN:
                self._swap(state=State.FROZEN)  # from now on a reply has named the failure
            raise

    def refuse_lost_trial(self) -> None:
        """Raise ABORTED.TRIAL_LOST if a restart dropped the trial."""
        if self.state is State.READY and self._now.trial_lost:
            raise SessionError(
                f"a trial of step {self.step + 1} from before the session was resumed is lost",
                code="ABORTED.TRIAL_LOST",
                hint="send the MOVE again, then COMMIT: its answer will be the same",
                details={"step": self.step + 1},
            )

    def require_next_step(self, step: int) -> None:
        """Raise unless ``step`` is the one after the last committed one.

        Raises SessionError: FAILED_PRECONDITION.STEP; ABORTED.STEPS_LOST if answered steps may have been lost because
        they were not durable.
        """
        # only "relaxed" answers a COMMIT before it is durable, and only the end of a process loses such a step
        if step > self.step + 1 and self._reopened and self.spec.durability == "relaxed":
            raise SessionError(
                f"step {self.step} is the last one that survived a restart of the session's worker, got step {step}",
                code="ABORTED.STEPS_LOST",
                hint=f"go on with step {self.step + 1}: the answers to its MOVE will be the same",
                details={"expected": self.step + 1, "got": step},
            )
        if step != self.step + 1:
            raise SessionError(
                f"expected step {self.step + 1} (step {self.step} is committed), got step {step}",
                code="FAILED_PRECONDITION.STEP",
                details={"expected": self.step + 1, "got": step},
            )

    def require_later(self, time: float | None) -> None:
        """Raise InvalidInput unless ``time``, if given, is later by a usable step than the last one committed."""
        last = self.time
        if time is None or last is None:
            return
        if not _STEPS[0] <= time - last <= _STEPS[1]:
            by = "" if time <= last else f", by {_STEPS[0]:.0e} to {_STEPS[1]:.0e}"
            raise InvalidInput(
                f"time: expected more than {last!r}, that of step {self.step}{by}, got {time!r}",
                code="INVALID_ARGUMENT.VALUE",
                hint="give the time at the end of the step, in seconds; OPEN has the time of the reference mesh",
                details={"field": "time", "value": float(time), "expected": float(last)},
            )

    def require_time_of_commit(self, time: float | None) -> None:
        """Raise InvalidInput unless a COMMIT with this ``time`` fits the trial and the session's time levels."""
        self.require_later(time)
        of_move = self._open_trial.time
        # equal to the bit: the velocities of the trial were computed with the time of the MOVE
        if time is not None and of_move is not None and time != of_move:
            raise InvalidInput(
                f"time: expected {of_move!r}, that of the step's last MOVE, got {time!r}",
                code="INVALID_ARGUMENT.VALUE",
                hint="leave it out, or send the MOVE again with another time",
                details={"field": "time", "value": float(time), "expected": float(of_move)},
            )
        if self.spec.time_levels and time is None and of_move is None:
            raise InvalidInput(
                f"time: a session with time_levels = {self.spec.time_levels!r} must know the time of each step",
                code="INVALID_ARGUMENT.VALUE",
                hint="give the time of the step, in MOVE or in COMMIT",
                details={"field": "time"},
            )

    def require_velocity(self, scheme: str, time: float | None) -> None:
        """Raise unless velocities of this scheme are possible for a MOVE to this ``time``.

        Raises InvalidInput if the time is missing, or if a tangent is requested but there is no derivative. Raises
        SessionError if the session has not stored the levels of the scheme, or does not know the time of the last step.
        """
        if scheme == "tangent":
            refusal = self.model.why_no_slope()
            if refusal is not None:
                raise refusal
            return
        # "bdf1" takes the committed state alone, which every session has
        if scheme not in ("bdf1", self.spec.time_levels):
            raise SessionError(
                f"velocity = {scheme!r} takes earlier time levels, which this session does not store",
                code="FAILED_PRECONDITION",
                hint=f"open it with time_levels = {scheme!r}; 'bdf1' and 'tangent' take none",
                details={"field": "velocity", "value": scheme},
            )
        if time is None:
            raise InvalidInput(
                f"velocity = {scheme!r}: time is missing",
                code="INVALID_ARGUMENT.VALUE",
                hint="give the MOVE the time at the end of the step, in seconds",
                details={"field": "time"},
            )
        if self.time is None:
            raise SessionError(
                f"velocity = {scheme!r}: the time of step {self.step} is not known",
                code="FAILED_PRECONDITION",
                hint="give time with each MOVE or COMMIT; velocities are available from the next step on",
                details={"field": "time", "step": self.step},
            )

    def require_client_evaluation(self) -> None:
        """Raise SessionError FAILED_PRECONDITION.STATE if the server judges the cells itself."""
        if self.spec.evaluation != "client":
            raise SessionError(
                "the server judges the cells of this session itself",
                hint="send COMMIT; JUDGE is for sessions that were opened with evaluation = 'client'",
            )

    def mesh_warnings(self) -> list[str]:
        """Warnings of the build, in the numbering of the upload."""
        return checked_warnings(self.mesh, self.model)

    def coordinates(self, frame: str) -> Floats:
        """(n, d) coordinates in canonical order: "committed" or "reference"."""
        committed = self._now.committed
        return self.mesh.points if frame == "reference" or committed is None else committed.points

    def field(self, frame: str) -> Field | None:
        """The field that gives "committed" or "reference" coordinates, if the client evaluates it."""
        rest, committed = self._require_built().field, self._now.committed
        if rest is None or frame == "reference" or committed is None or committed.coefficients is None:
            return rest
        return replace(rest, coefficients=committed.coefficients)

    def field_part(self, field: Field | None, partition: int) -> Field | None:
        """The part of a field that a partition needs."""
        return None if field is None else self._require_built().field_parts[partition].of(field.coefficients)

    def field_rows(self, partition: int) -> Integers:
        """(r,) rows of a field's coefficients that a partition has."""
        built = self._require_built()
        count = 0 if built.field is None else len(built.field.coefficients)
        return np.arange(count)[built.field_parts[partition].rows]

    def region(self, frame: str) -> Extent | None:
        """The region to correct after the field of "committed" coordinates, if these were corrected."""
        committed = self._now.committed
        corrected = frame == "committed" and committed is not None and committed.corrected
        return first_extent(self.model.method, self.spec.dimension) if corrected else None

    @property
    def time(self) -> float | None:
        """Time of the last committed step, seconds; None if it is not known."""
        return self.spec.time if self._now.committed is None else self._now.committed.level.time

    @property
    def _committed_state(self) -> CommittedState:
        if self._now.committed is None:
            raise SessionError("the mesh is not built yet", hint="send UPLOAD and BUILD first")
        return self._now.committed

    @property
    def _open_trial(self) -> Trial:
        if self._now.trial is None:
            raise SessionError("there is no trial", hint="send MOVE first")
        return self._now.trial

    def _swap(self, **changes: Any) -> None:
        self._now = replace(self._now, **changes)

    def _require_built(self) -> Built:
        if self._built is None:
            raise SessionError("the mesh is not built yet", hint="send UPLOAD and BUILD first")
        return self._built
