"""Turns a server error into the reply to a request; used for session commands and by transport."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mesh_motion_protocol.errors import MeshMotionError, ProtocolError, brief, brief_details, error_code
from mesh_motion_protocol.messages import ErrorReply, Message


def error_reply(
    request: Message | ProtocolError,
    error: MeshMotionError | ProtocolError,
    *,
    state: str = "",
    further: Mapping[str, Any] | None = None,
) -> ErrorReply:
    """Make the reply to the request that raised ``error``; ``further`` is added to the error's own details."""
    known = error_code(error.code)
    return ErrorReply(
        client=request.client,
        sequence=request.sequence,
        code=error.code,
        message=brief(error.message),
        hint=error.hint or known.hint,
        retryable=known.retryable,
        state=state,
        details=brief_details(error.details) | dict(further or {}),
    )
