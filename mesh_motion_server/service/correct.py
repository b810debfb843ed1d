"""CORRECT: the ranks of a client send the bad cells; the session corrects them, or requests more cells."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mesh_motion_numerics.distributed.region import Region
from mesh_motion_protocol.messages import Correct, Corrected

from mesh_motion_server.session.session import Session
from mesh_motion_server.session.state import Operation


def check(session: Session, request: Correct) -> tuple[Correct, Region]:
    """Check the step and the state, and that the session's cells are with the client.

    Raises SessionError: FAILED_PRECONDITION.STATE or .STEP; ABORTED.TRIAL_LOST. Raises InvalidInput if the fields are
    inconsistent.
    """
    session.require_client_evaluation()
    session.admit(Operation.CORRECT if request.what == "trial" else Operation.FETCH)
    session.require_next_step(request.step)
    return request, Region.read(vars(request), partition=request.partition)


def run(session: Session, parts: Sequence[tuple[Correct, Region]]) -> list[Corrected]:
    """Correct the region, or request a larger one."""
    found = session.correct(parts[0][0].what, [region for _, region in parts])
    reply: dict[str, Any] = {
        "region": {} if found.extent is None else found.extent.as_plain(),
        "nodes": found.nodes,
        "displacement": found.displacement,
    }
    return [Corrected(client=one.client, sequence=one.sequence, step=one.step, **reply) for one, _ in parts]
