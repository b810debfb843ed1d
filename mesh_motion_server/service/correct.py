"""CORRECT: the ranks of a client send the bad cells; the session corrects them, or asks for more."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mesh_motion_numerics.distributed.region import Region
from mesh_motion_protocol.messages import Correct, Corrected

from mesh_motion_server.session.session import Session
from mesh_motion_server.session.state import Operation

__all__ = ["check", "run"]


def check(session: Session, request: Correct) -> None:
    """Check the step and the state, and that the session's cells are with the client.

    Raises
    ------
    SessionError
        FAILED_PRECONDITION.STATE or .STEP; ABORTED.TRIAL_LOST.
    InvalidInput
        If the fields do not fit together.
    """
    session.require_client_evaluation()
    session.admit(Operation.CORRECT if request.what == "trial" else Operation.FETCH)
    session.require_next_step(request.step)
    Region.read(vars(request), partition=request.partition)


def run(session: Session, requests: Sequence[Correct]) -> list[Corrected]:
    """Correct the region, or ask for a larger one."""
    told = [Region.read(vars(one), partition=one.partition) for one in requests]
    found = session.correct(requests[0].what, told)
    reply: dict[str, Any] = {
        "region": {} if found.extent is None else found.extent.as_plain(),
        "nodes": found.nodes,
        "displacement": found.displacement,
    }
    return [Corrected(client=one.client, sequence=one.sequence, step=one.step, **reply) for one in requests]
