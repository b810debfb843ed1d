"""The base of all messages, and the reply to a request that failed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from mesh_motion_protocol.field_types import Count, Uuid

__all__ = ["ErrorReply", "Message"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Message:
    """Base of all messages.

    Attributes
    ----------
    client : bytes
        16-byte UUID of the client, made once per client object. On a reply: that of the request.
    sequence : int
        1, 2, 3, … per client. (client, sequence) is the *request id*: a repeat with the same content gets the stored
        reply, a repeat with other content ABORTED.CONFLICT. On a reply: that of the request.
    """

    type: ClassVar[str] = ""
    client: Uuid = b"\0" * 16
    sequence: Count = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorReply(Message):
    """Answer to any request that failed. Nothing of the request took effect."""

    type: ClassVar[str] = "ERROR"
    code: str  # a code of SPEC.md, e.g. "INVALID_ARGUMENT.NONFINITE"
    message: str  # what was expected, what came
    hint: str  # the way out
    retryable: bool  # the same request may succeed later
    state: str  # the session's state afterwards, "" when there is none
    details: dict[str, Any]  # names the first offender: section 15
