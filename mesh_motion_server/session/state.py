"""The session's state machine as a table, and the values that it replaces.

::

    NEW ──UPLOAD──▶ OPENING ──BUILD──▶ READY ──MOVE──▶ TRIAL ──COMMIT──▶ (COMMITTING) ──▶ READY
                                         ▲────────────ROLLBACK──┘

Side states: SUSPENDED (the lease was lost), FROZEN (the disk failed; nothing more is written), FAILED (an unexpected
failure; nothing is trusted), CLOSED. COMMITTING lasts while a commit is made durable. :data:`TABLE` is the only source
for the allowed operations in each state; SPEC.md's table is made from it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.motion.time_levels import TimeLevel, level_after
from mesh_motion_protocol.errors import SessionError

if TYPE_CHECKING:
    from mesh_motion_numerics.correction.correction import Correction
    from mesh_motion_numerics.quality.quality_summary import Judgement, QualitySummary

    from mesh_motion_server.session.partitions.meshes import MergedMesh


class State(StrEnum):
    """The states of a session."""

    NEW = "NEW"
    OPENING = "OPENING"
    READY = "READY"
    TRIAL = "TRIAL"
    COMMITTING = "COMMITTING"
    SUSPENDED = "SUSPENDED"
    FROZEN = "FROZEN"
    FAILED = "FAILED"
    CLOSED = "CLOSED"


class Operation(StrEnum):
    """The operations on a session: its requests, RESUME by a new holder, and the end of the lease."""

    JOIN = "JOIN"
    UPLOAD = "UPLOAD"
    BUILD = "BUILD"
    MOVE = "MOVE"
    TANGENT = "TANGENT"
    COTANGENT = "COTANGENT"
    JUDGE = "JUDGE"
    CORRECT = "CORRECT"
    COMMIT = "COMMIT"
    ROLLBACK = "ROLLBACK"
    FETCH = "FETCH"
    STATUS = "STATUS"
    CLOSE = "CLOSE"
    RESUME = "RESUME"
    LEASE_END = "LEASE_END"


@dataclass(frozen=True)
class Refusal:
    """The reason why an operation is not allowed in a state, and the way out."""

    message: str
    hint: str
    code: str = "FAILED_PRECONDITION.STATE"


Row = Mapping[Operation, State | Refusal]

_NO_MESH = Refusal("no mesh has been uploaded", "send UPLOAD first")
_NOT_BUILT = Refusal("the mesh is not built yet", "send UPLOAD and BUILD first")
_BUILT = Refusal("the mesh is already built", "open another session for another mesh")
_NO_TRIAL = Refusal("there is no trial to commit", "send MOVE first")
_NOT_MOVED = Refusal("there is no trial to judge", "send MOVE first")
_COMMITTING = Refusal("a commit is being made durable", "wait for its reply")
_SUSPENDED = Refusal("the session is suspended: no message of its holder came within the lease", "send JOIN again")
_FROZEN = Refusal(
    "the disk failed while the session was written, nothing more is written",
    "check the disk, send CLOSE with outcome 'keep', then RESUME",
    "RESOURCE_EXHAUSTED.DISK",
)
_FAILED = Refusal("the session failed unexpectedly", "send CLOSE with outcome 'keep', then RESUME")
_CLOSED = Refusal("the session is closed", "send RESUME to the control endpoint")

_S, _O = State, Operation


def _row(
    default: Refusal, allowed: Mapping[Operation, State], refused: Mapping[Operation, Refusal] | None = None
) -> Row:
    """Make one state's row: allowed operations, particular refusals, and the refusal of the others."""
    cells: dict[Operation, State | Refusal] = dict.fromkeys(Operation, default)
    return MappingProxyType(cells | dict(allowed) | dict(refused or {}))


def _staying(state: State, *operations: Operation) -> dict[Operation, State]:
    return dict.fromkeys(operations, state)


#: state × operation → the state afterwards (if the operation succeeds), or the refusal.
TABLE: Mapping[State, Row] = MappingProxyType(
    {
        _S.NEW: _row(
            _NOT_BUILT,
            _staying(_S.NEW, _O.JOIN, _O.STATUS, _O.RESUME)
            | {_O.UPLOAD: _S.OPENING, _O.CLOSE: _S.CLOSED, _O.LEASE_END: _S.CLOSED},
            {_O.BUILD: _NO_MESH},
        ),
        _S.OPENING: _row(
            _NOT_BUILT,
            _staying(_S.OPENING, _O.JOIN, _O.STATUS, _O.UPLOAD, _O.RESUME)
            | {_O.BUILD: _S.READY, _O.CLOSE: _S.CLOSED, _O.LEASE_END: _S.CLOSED},
        ),
        _S.READY: _row(
            _BUILT,
            _staying(_S.READY, _O.JOIN, _O.STATUS, _O.FETCH, _O.TANGENT, _O.COTANGENT, _O.ROLLBACK, _O.RESUME)
            | {_O.MOVE: _S.TRIAL, _O.CLOSE: _S.CLOSED, _O.LEASE_END: _S.SUSPENDED},
            {_O.JUDGE: _NOT_MOVED, _O.CORRECT: _NOT_MOVED, _O.COMMIT: _NO_TRIAL},
        ),
        _S.TRIAL: _row(
            _BUILT,
            _staying(_S.TRIAL, _O.JOIN, _O.STATUS, _O.FETCH, _O.MOVE, _O.TANGENT, _O.COTANGENT, _O.JUDGE, _O.CORRECT)
            | _staying(_S.READY, _O.COMMIT, _O.ROLLBACK, _O.RESUME)
            | {_O.CLOSE: _S.CLOSED, _O.LEASE_END: _S.SUSPENDED},
        ),
        _S.COMMITTING: _row(_COMMITTING, _staying(_S.COMMITTING, _O.STATUS, _O.LEASE_END)),
        _S.SUSPENDED: _row(
            _SUSPENDED,
            _staying(_S.READY, _O.JOIN, _O.RESUME)
            | _staying(_S.SUSPENDED, _O.STATUS, _O.LEASE_END)
            | {_O.CLOSE: _S.CLOSED},
        ),
        _S.FROZEN: _row(
            _FROZEN,
            _staying(_S.FROZEN, _O.JOIN, _O.STATUS, _O.FETCH, _O.LEASE_END) | {_O.CLOSE: _S.CLOSED},
        ),
        _S.FAILED: _row(
            _FAILED,
            _staying(_S.FAILED, _O.JOIN, _O.STATUS, _O.LEASE_END) | {_O.CLOSE: _S.CLOSED},
        ),
        _S.CLOSED: _row(_CLOSED, _staying(_S.CLOSED, _O.LEASE_END)),
    }
)


def admit(state: State, operation: Operation) -> State:
    """The state after ``operation`` succeeds in ``state``.

    Raises SessionError if the table does not allow it; the details carry state and operation.
    """
    cell = TABLE[state][operation]
    if isinstance(cell, State):
        return cell
    raise SessionError(
        f"{operation} is not allowed in state {state}: {cell.message}",
        code=cell.code,
        hint=cell.hint,
        details={"state": str(state), "operation": str(operation)},
    )


@dataclass(frozen=True, eq=False)
class CommittedState:
    """The durable values: the step and the positions of its nodes."""

    step: int  # 0 for the mesh as uploaded
    points: Floats  # (n, d), mesh length unit. Coordinates in the session's canonical node order; read-only
    coefficients: Floats | None = None  # (r, d). Coefficients of the field, if the client evaluates it
    corrected: bool = False  # whether the client's nodes were corrected after the field's displacement
    #: The time of the step, and the data of earlier steps for velocities; arrays read-only, in canonical order.
    level: TimeLevel = field(default_factory=TimeLevel)


@dataclass(frozen=True, eq=False)
class MoveInput:
    """The input of a motion; together with mesh, settings and committed state it determines the motion."""

    frame: str  # {"committed", "reference"}
    #: (k, d), mesh length unit. Displacement of the moving nodes in this frame, in the order of the mesh's ``moving``.
    boundary_displacement: Floats


@dataclass(frozen=True, eq=False)
class Trial:
    """The result of the last MOVE, which no COMMIT has confirmed yet."""

    #: step, iteration: the step that it would become, and the number of MOVEs of this step
    step: int
    iteration: int
    points: Floats  # (n, d), mesh length unit. Trial coordinates in canonical order; read-only
    quality: Judgement | None  # quality of ``points``, if the Move or a Judge has judged exactly these coordinates
    input: MoveInput
    coefficients: Floats | None = None  # (r, d). Coefficients of the field, if the client evaluates it
    standard: QualitySummary | None = None  # quality of the client's mesh before its correction
    #: Result of the client's correction, without coordinates; ``points`` are not changed by it.
    correction: Correction | None = None
    time: float | None = None  # time of the step, seconds, if the Move had it


def state_after(before: CommittedState, trial: Trial, time_levels: str, time: float | None) -> CommittedState:
    """The state that a commit of the ``trial`` makes from the state before."""
    level = level_after(time_levels, trial.points, before.points, before.level, time)
    return CommittedState(trial.step, trial.points, trial.coefficients, trial.correction is not None, level)


def durable_rows(mesh: MergedMesh, state: CommittedState) -> Floats:
    """The rows that a commit stores: coordinates (n, d), ascending by global id, then the coefficients, if any, and the
    arrays of earlier time levels, in the same order.
    """
    rows = [np.take(values, mesh.id_order, axis=0) for values in (state.points, *state.level.arrays)]
    if state.coefficients is not None:
        rows.append(state.coefficients)
    return rows[0] if len(rows) == 1 else np.concatenate(rows)
