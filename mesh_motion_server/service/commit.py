"""COMMIT: the trial becomes the committed state, durable as the session's level defines it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgpack
from mesh_motion_protocol.messages import Commit as CommitRequest
from mesh_motion_protocol.messages import Committed

from mesh_motion_server.failpoints import failpoint
from mesh_motion_server.service.commands import id_of
from mesh_motion_server.service.reports import summary_report
from mesh_motion_server.session.journal.ledger import Commit
from mesh_motion_server.session.journal.replies import RequestId
from mesh_motion_server.session.session import Session
from mesh_motion_server.session.state import Operation, State
from mesh_motion_server.session.values import CommitOutcome


def check(session: Session, request: CommitRequest) -> CommitRequest:
    """Check the step, then the state: a repeated step and a missing trial give different errors."""
    if session.state in (State.READY, State.TRIAL):
        session.require_next_step(request.step)
    session.admit(Operation.COMMIT)
    session.require_time_of_commit(request.time)
    return request


def run(session: Session, requests: Sequence[CommitRequest]) -> list[Committed]:
    """Commit; the replies are journaled with the state, each with the identity of its request."""
    content: dict[str, Any] = {}

    def receipt(outcome: CommitOutcome) -> bytes:
        content.update(
            step=outcome.step,
            durable_step=outcome.durable_step,
            digest=outcome.digest,
            quality=summary_report(outcome.quality, session.mesh),
        )
        final_step = max(request.final_step for request in requests)
        level = outcome.level
        times = () if level.time is None else (level.time, level.previous_time)
        noted = {"final_step": final_step, "corrected": outcome.corrected, "times": times}
        packed: bytes = msgpack.packb(content | {name: value for name, value in noted.items() if value})
        return packed

    session.commit([id_of(request) for request in requests], receipt, time=requests[0].time)
    failpoint("request.committed")
    return [Committed(client=request.client, sequence=request.sequence, **content) for request in requests]


def replies_of(commit: Commit) -> list[tuple[RequestId, Committed]]:
    """Make the replies to a journaled commit, with the request that each one answers."""
    content = msgpack.unpackb(commit.receipt)
    for name in ("final_step", "corrected", "times"):  # not a part of the reply
        content.pop(name, None)
    return [(r, Committed(client=r.client, sequence=r.sequence, **content)) for r in commit.requests]
