"""JOIN: a connection proves its right to the session and then holds a partition."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Integers
from mesh_motion_protocol.messages import Join, Joined

from mesh_motion_server.security.authorisation import not_found
from mesh_motion_server.session.session import Session

#: Space in the header of JOINED (``max_container_items``, ``max_header_bytes``).
_MOST_PATCHES, _MOST_NAME_BYTES = 256, 1 << 15


def answer(session: Session, request: Join) -> Joined:
    """Check the token; reply with the state of the session and the data that the partition needs.

    Raises SessionError: NOT_FOUND for a wrong token, the same as for an unknown session.
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
        extent=mesh.extent if mesh else 0.0,
        time=session.time,
        moving_nodes=mesh.moving_local[request.partition] if mesh else None,
        **_named(mesh.moving_patches[request.partition] if mesh else {}),
    )


def _named(patches: Mapping[str, Integers]) -> dict[str, Any]:
    """The fields of JOINED for the moving patches of a partition; none if their names do not fit into a header."""
    if len(patches) > _MOST_PATCHES or sum(len(name.encode()) for name in patches) > _MOST_NAME_BYTES:
        return {}
    return {
        "moving_patches": [[name, len(nodes)] for name, nodes in patches.items()],
        "patch_nodes": np.concatenate([np.empty(0, dtype=np.int64), *patches.values()]),
    }
