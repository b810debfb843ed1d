"""ROLLBACK: drops the trial of a step, if there is one."""

from __future__ import annotations

from collections.abc import Sequence

from mesh_motion_protocol.messages import Rollback, RolledBack

from mesh_motion_server.session.session import Session
from mesh_motion_server.session.state import Operation


def check(session: Session, request: Rollback) -> Rollback:
    """Check state and step."""
    session.admit(Operation.ROLLBACK)
    session.require_next_step(request.step)
    return request


def run(session: Session, requests: Sequence[Rollback]) -> list[RolledBack]:
    """Drop the trial; the reply names the last committed step."""
    session.rollback()
    return [RolledBack(client=request.client, sequence=request.sequence, step=session.step) for request in requests]
