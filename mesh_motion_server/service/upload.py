"""UPLOAD: one part of a partition's mesh."""

from __future__ import annotations

import numpy as np
from mesh_motion_protocol.errors import InvalidInput
from mesh_motion_protocol.messages import Upload, Uploaded

from mesh_motion_server.session.partitions.uploads import Part
from mesh_motion_server.session.session import Session


def answer(session: Session, request: Upload) -> Uploaded:
    """Append the part.

    Raises InvalidInput if there are no rows, or as
    :meth:`~mesh_motion_server.session.partitions.uploads.MeshUpload.add`.
    """
    if request.rows is None:
        raise InvalidInput(
            f"UPLOAD of {request.item}: the array 'rows' is required",
            code="INVALID_ARGUMENT.SHAPE",
            details={"item": request.item},
        )
    part = Part(request.item, request.name, request.role, np.asarray(request.rows))
    total = session.add_part(request.partition, part)
    return Uploaded(client=request.client, sequence=request.sequence, rows_total=total)
