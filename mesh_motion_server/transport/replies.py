"""The replies that transport itself gives, and the encoding of all replies as frames."""

from collections.abc import Mapping
from typing import Any

from mesh_motion_protocol.arrays import Buffer
from mesh_motion_protocol.codec import encode
from mesh_motion_protocol.errors import MeshMotionError, ProtocolError
from mesh_motion_protocol.messages import ErrorReply, Message

from mesh_motion_server.service.error_replies import error_reply
from mesh_motion_server.transport.telemetry import log


def undecodable(error: ProtocolError, *, state: str = "") -> ErrorReply:
    """Return the reply to frames that are not a valid message."""
    return error_reply(error, error, state=state)


def unexpected(request: Message, endpoint: str, *, state: str = "") -> ErrorReply:
    """Return the reply to a message that this endpoint does not accept."""
    error = MeshMotionError(
        f"the {endpoint} endpoint does not take {request.type}",
        code="UNIMPLEMENTED.MESSAGE",
        hint="HELLO, OPEN, RESUME, LIST, PROBE go to the control endpoint, all others to the session's data endpoint",
    )
    return error_reply(request, error, state=state)


def encoded(reply: Message, *, state: str = "", memory: Mapping[str, Any] | None = None) -> list[Buffer]:
    """Encode a reply as frames; a reply that cannot be encoded becomes an error reply.

    Large arrays are written to ``memory`` if it is given.
    """
    try:
        return encode(reply, memory)
    except ProtocolError as error:  # a client without an answer would repeat its request in vain
        log().error("unencodable", reply=reply.type, reason=error.message)
        failure = MeshMotionError(f"the reply cannot be put on the wire: {error.message}", code="INTERNAL")
        # not into the memory: an error has no arrays
        return encode(error_reply(reply, failure, state=state))
