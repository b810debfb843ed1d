"""Turns an exception into the error reply."""

from __future__ import annotations

import logging
from typing import Any

from mesh_motion_protocol.errors import MeshMotionError, QualityRefused, ResourceExhausted
from mesh_motion_protocol.messages import ErrorReply, Message

from mesh_motion_server.service.error_replies import error_reply
from mesh_motion_server.service.reports import worst_places
from mesh_motion_server.session.session import Session

_LOG = logging.getLogger(__name__)


def known_error(error: Exception) -> MeshMotionError:
    """Convert to a known error; an unexpected one becomes INTERNAL and is logged with its trace."""
    if isinstance(error, MeshMotionError):
        return error
    if isinstance(error, MemoryError):
        return ResourceExhausted(
            "the request does not fit into the worker's memory",
            code="RESOURCE_EXHAUSTED.MEMORY",
            hint="raise the server's worker_memory_bytes",
        )
    _LOG.error("a request failed unexpectedly", exc_info=error)
    return MeshMotionError(f"unexpected {type(error).__name__}: {error}", code="INTERNAL")


def failure_reply(request: Message, error: MeshMotionError, session: Session) -> ErrorReply:
    """Make the reply to a failed request; cells are named in the sender's numbering."""
    return error_reply(request, error, state=str(session.state), further=_where(error, session))


def _where(error: MeshMotionError, session: Session) -> dict[str, Any]:
    """The accepted fraction of a refused motion, and its worst cells."""
    if not isinstance(error, QualityRefused):
        return {}
    worst = worst_places(error.cells, session.mesh) if session.is_built else []
    return {"best": error.best, "fraction": error.fraction, "worst": worst}
