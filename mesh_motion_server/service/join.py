"""JOIN: a connection proves its right to the session and then holds a partition."""

from __future__ import annotations

from mesh_motion_protocol.messages import Join, Joined

from mesh_motion_server.security.authorisation import not_found
from mesh_motion_server.session.session import Session

__all__ = ["answer"]


def answer(session: Session, request: Join) -> Joined:
    """Check the token; reply with the state of the session and what the partition needs.

    Raises
    ------
    SessionError
        NOT_FOUND for a wrong token, the same as for an unknown session.
    """
    if not session.spec.admits(request.token):
        raise not_found(request.session)
    session.join()
    mesh = session.mesh if session.is_built else None
    return Joined(
        client=request.client,
        sequence=request.sequence,
        state=str(session.state),
        step=session.step,
        iteration=session.iteration,
        dimension=session.spec.dimension,
        partitions=session.spec.partitions,
        nodes=len(mesh.node_maps[request.partition]) if mesh else 0,
        evaluation=session.spec.evaluation,
        moving_nodes=mesh.moving_local[request.partition] if mesh else None,
    )
