"""FETCH: a partition's node coordinates."""

from __future__ import annotations

from mesh_motion_protocol.errors import InvalidInput
from mesh_motion_protocol.messages import Fetch, Fetched

from mesh_motion_server.service.move import FRAMES
from mesh_motion_server.session.session import Session
from mesh_motion_server.session.state import Operation


def answer(session: Session, request: Fetch) -> Fetched:
    """Reply with committed or reference coordinates, in the order of the partition's upload.

    Raises SessionError if the mesh is not built. Raises InvalidInput on an unknown ``what``.
    """
    session.admit(Operation.FETCH)
    if request.what not in FRAMES:
        raise InvalidInput(
            f"what: expected one of {', '.join(FRAMES)}, got {request.what!r}",
            code="INVALID_ARGUMENT.VALUE",
            details={"what": str(request.what)},
        )
    points = session.mesh.scatter(session.coordinates(request.what), request.partition)
    field = session.field_part(session.field(request.what), request.partition)
    extent = session.region(request.what)
    return Fetched(
        client=request.client,
        sequence=request.sequence,
        step=session.step,
        points=points,
        region={} if extent is None else extent.as_plain(),
        nodes=session.mesh.ids_of(request.partition)
        if request.what == "reference" and len(session.mesh.near)
        else None,
        **({} if field is None else vars(field)),
    )
