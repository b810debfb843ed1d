"""CLOSE: a partition leaves the session; when the last one has left, the session is closed and kept, or discarded."""

from __future__ import annotations

from mesh_motion_protocol.errors import InvalidInput
from mesh_motion_protocol.messages import Close, Closed

from mesh_motion_server.session.session import Session
from mesh_motion_server.session.state import Operation

#: "keep" leaves the session durable and resumable, "discard" deletes it.
OUTCOMES = ("keep", "discard")


def answer(session: Session, request: Close) -> Closed:
    """Check the request and, if the session is kept, make its state durable; this is the last durable step.

    Raises DataLoss if the disk fails during the call; the session is then FROZEN, and closes when CLOSE is sent again.
    Raises SessionError if the state does not allow it. Raises InvalidInput on an unknown outcome.
    """
    session.admit(Operation.CLOSE)
    if request.outcome not in OUTCOMES:
        raise InvalidInput(
            f"outcome: expected one of {', '.join(OUTCOMES)}, got {request.outcome!r}",
            code="INVALID_ARGUMENT.VALUE",
            details={"outcome": str(request.outcome)},
        )
    if request.outcome == "keep":
        session.catch_up()
    return Closed(client=request.client, sequence=request.sequence, step=session.durable_step)
