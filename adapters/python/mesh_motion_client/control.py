"""The client's side of the control endpoint: HELLO, OPEN, RESUME, LIST and PROBE, repeated until they are answered.

An OPEN or RESUME may have executed although its reply never came. A later request with the same content therefore keeps
its id, whatever was requested in between: the client finds the opened session again, and its own RESUME does not fence
it.
"""

from __future__ import annotations

import logging
import os
import threading
import time
import uuid
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

from mesh_motion_protocol.digests import request_digest
from mesh_motion_protocol.errors import MeshMotionError, ProtocolError, Timeout, Unavailable
from mesh_motion_protocol.messages import Message, Open, Resume

from mesh_motion_client.connection import Connection, ConnectionLost, DamagedReply, check_process, seconds_left, turn
from mesh_motion_client.keys import Keys

__all__ = ["Control"]

_Reply = TypeVar("_Reply", bound=Message)

_LOG = logging.getLogger(__name__)

#: Seconds without an answer before a warning; the second value if a worker has to start.
_SILENT_SECONDS, _STARTING_SECONDS = 1.5, 10.0
#: Pause between two tries while no server answers, seconds.
_PAUSE_SECONDS = 0.2
#: Requests that must execute only once.
_KEPT = (Open, Resume)
#: Largest number of unanswered requests whose ids are kept; no server remembers more than about a thousand.
_MOST_UNANSWERED = 1000
#: Errors after which it is not known whether the request executed.
_UNHEARD = (Timeout, Unavailable, DamagedReply)


class Control:
    """Sends requests to the control endpoint; a repeated request executes only once.

    Parameters
    ----------
    keys : Keys, optional
        For a server that requires keys.

    Attributes
    ----------
    waits_until : float
        End of the user's call, on the monotonic clock; the warning names it.
    """

    def __init__(self, endpoint: str, keys: Keys | None = None) -> None:
        self.endpoint = endpoint
        self.waits_until = 0.0
        self._keys = keys
        self._process = os.getpid()
        self._turn = threading.RLock()
        self._client = uuid.uuid4().bytes
        self._sequence = 0
        self._unanswered: dict[bytes, int] = {}
        self._connection: Connection | None = None
        self._is_silent = False  # a warning has said so

    def ask(self, kind: type[Message], expected: type[_Reply], seconds: float, **fields: Any) -> _Reply:
        """Send a request of this kind until it is answered or the time is over; log one warning if there is no answer.

        Raises
        ------
        Timeout, Unavailable, MeshMotionError
        """
        check_process(self._process)
        deadline = time.monotonic() + seconds
        with turn(self._turn, deadline):
            return self._asked(kind, expected, deadline, fields)

    def _asked(self, kind: type[Message], expected: type[_Reply], deadline: float, fields: dict[str, Any]) -> _Reply:
        message = kind(client=self._client, sequence=self._sequence + 1, **fields)
        content = None
        if isinstance(message, _KEPT):
            with suppress(ProtocolError):  # the send below refuses it
                content = request_digest(message)
        message = replace(message, sequence=self._number(content))
        try:
            reply = self._answer(message, deadline, partial(self._warn, message, time.monotonic(), deadline))
        except MeshMotionError as error:
            if content is not None and not isinstance(error, _UNHEARD):
                del self._unanswered[content]
            raise
        if content is not None:
            del self._unanswered[content]
        if not isinstance(reply, expected):
            raise TypeError(f"{kind.type} is answered by {reply.type}, not {expected.type}")
        return reply

    def _answer(self, message: Message, deadline: float, warn: Callable[[], None]) -> Message:
        """Return the reply; repeat the request until it arrives."""
        while True:
            try:
                reply = self._connected().request(message, deadline, warn)
                self._is_silent = False
                return reply
            except Timeout:
                self.close()  # a silent connection may be lost without an event
                raise
            except Unavailable as error:
                if isinstance(error, ConnectionLost):
                    self.close()
                    warn()
                if seconds_left(deadline) <= _PAUSE_SECONDS:
                    raise
                time.sleep(_PAUSE_SECONDS)

    def _warn(self, message: Message, asked_at: float, deadline: float) -> None:
        """Log one warning that no server answers: the call may go on waiting for half an hour."""
        starts = isinstance(message, _KEPT)
        if self._is_silent or time.monotonic() - asked_at < (_STARTING_SECONDS if starts else _SILENT_SECONDS):
            return
        self._is_silent = True
        who = f"{message.type} is not answered" if starts else "no server answers"
        _LOG.warning("%s at %s; asking for %.0f s", who, self.endpoint, seconds_left(max(deadline, self.waits_until)))

    def _number(self, content: bytes | None) -> int:
        """Return the next sequence number; an OPEN or RESUME equal to an unanswered one keeps that request's number."""
        known = self._unanswered.get(content) if content is not None else None
        if known is not None:
            return known
        self._sequence += 1
        if content is not None:
            self._unanswered[content] = self._sequence
            while len(self._unanswered) > _MOST_UNANSWERED:
                del self._unanswered[next(iter(self._unanswered))]
        return self._sequence

    def _connected(self) -> Connection:
        if self._connection is None or self._connection.closed:
            self._connection = Connection(self.endpoint, self._keys)
        return self._connection

    def data_connection(self, endpoint: str) -> Connection:
        """Return a connection to a session's worker, with the same keys."""
        return Connection(self.data_endpoint(endpoint), self._keys)

    def data_endpoint(self, endpoint: str) -> str:
        """Return the data endpoint for this client: a wildcard address means the host of the control endpoint."""
        host, _, port = endpoint.removeprefix("tcp://").rpartition(":")
        if endpoint.startswith("tcp://") and host in ("0.0.0.0", "[::]", "*"):
            return f"{self.endpoint.rpartition(':')[0]}:{port}"
        return endpoint

    def close(self) -> None:
        """Close the connection; the next request opens another one."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None
