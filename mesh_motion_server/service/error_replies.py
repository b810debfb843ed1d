"""An error of the server as the reply to a request: for a session's commands and for transport alike."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mesh_motion_protocol.errors import brief, brief_details, error_code
from mesh_motion_protocol.messages import ErrorReply, Message

from mesh_motion_server.errors import MeshMotionError

__all__ = ["error_reply"]


def error_reply(
    request: Message, error: MeshMotionError, *, state: str = "", further: Mapping[str, Any] | None = None
) -> ErrorReply:
    """The reply to a request that raised ``error``, with what is to stand in its details besides the error's own."""
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
