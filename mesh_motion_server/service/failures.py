"""From an exception to the error reply."""

from __future__ import annotations

import logging
from typing import Any

from mesh_motion_protocol.errors import brief, brief_details, error_code
from mesh_motion_protocol.messages import ErrorReply, Message

from mesh_motion_server.errors import MeshMotionError, NumericalError, ResourceError
from mesh_motion_server.service.reports import worst_places
from mesh_motion_server.session.session import Session

__all__ = ["error_reply", "known_error"]

_LOG = logging.getLogger(__name__)


def known_error(error: Exception) -> MeshMotionError:
    """The error as one of ours; what nobody foresaw is INTERNAL and logged with its trace."""
    if isinstance(error, MeshMotionError):
        return error
    if isinstance(error, MemoryError):
        return ResourceError(
            "the request does not fit into the worker's memory",
            code="RESOURCE_EXHAUSTED.MEMORY",
            hint="raise the server's worker_memory_bytes",
        )
    _LOG.error("a request failed unexpectedly", exc_info=error)
    return MeshMotionError(f"unexpected {type(error).__name__}: {error}", code="INTERNAL")


def error_reply(request: Message, error: MeshMotionError, session: Session) -> ErrorReply:
    """The reply to a request that failed; cells are named as their sender knows them."""
    known = error_code(error.code)
    return ErrorReply(
        client=request.client,
        sequence=request.sequence,
        code=error.code,
        message=brief(error.message),
        hint=error.hint or known.hint,
        retryable=known.retryable,
        state=str(session.state),
        details=_details(error, session),
    )


def _details(error: MeshMotionError, session: Session) -> dict[str, Any]:
    details = brief_details(error.details)
    if isinstance(error, NumericalError):
        details |= {"best": error.best, "fraction": error.fraction}
        details["worst"] = worst_places(error.cells, session.mesh) if session.is_built else []
    return details
