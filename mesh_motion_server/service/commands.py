"""The two shapes of a command, so that :mod:`.dispatch` can hold them in one table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from mesh_motion_protocol.digests import request_digest
from mesh_motion_protocol.messages import Message, SessionMessage

from mesh_motion_server.session.journal.replies import RequestId
from mesh_motion_server.session.session import Session


@dataclass(frozen=True)
class Single:
    """A command of one partition."""

    answer: Callable[[Session, Any], Message]  # (session, request) → reply
    #: Whether a repeat gets the stored reply. Otherwise the command changes nothing and is executed again.
    executes_once: bool


@dataclass(frozen=True)
class Collective:
    """A command of all partitions."""

    #: (session, request) → the data for ``run``. The request is read once, before it waits for the other partitions;
    #: raises if it is invalid.
    check: Callable[[Session, Any], Any]
    #: (session, results of ``check`` by partition) → replies by partition.
    run: Callable[[Session, Sequence[Any]], Sequence[Message]]


def id_of(request: SessionMessage) -> RequestId:
    """The id by which a repeat of the request is recognised."""
    return RequestId(request.client, request.sequence, request_digest(request))
