"""A minimal client for rows: one DEALER socket, one request at a time, and whether the server admitted it."""

import itertools
import os
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from types import TracebackType
from typing import Any, Self

import zmq
import zmq.utils.monitor
from mesh_motion_client import Keys
from mesh_motion_protocol.codec import decode, encode
from mesh_motion_protocol.messages import Message

from tests.faults.check import BrokenPromise
from tests.faults.limited_context import shared_context

#: Longest wait for a reply that has to come, on a machine that may be busy; seconds.
_PATIENCE = 120
_REFUSALS = zmq.EVENT_HANDSHAKE_FAILED_AUTH | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL


class Wire:
    """A connection, a context manager.

    ``frames``: frames of the last reply; ``seconds``: time from the last request to its reply.
    """

    def __init__(self, endpoint: str, keys: Keys | None = None) -> None:
        self.frames: list[bytes] = []
        self.seconds = 0.0
        self._client, self._numbers = os.urandom(16), itertools.count(1)
        self._socket: zmq.Socket[bytes] = shared_context().socket(zmq.DEALER)
        if keys is not None:
            keys.protect(self._socket)
        self._events: zmq.Socket[bytes] = self._socket.get_monitor_socket(_REFUSALS)
        self._socket.connect(endpoint)

    def request(self, kind: Callable[..., Message], **fields: Any) -> Message:
        return kind(**{"client": self._client, "sequence": next(self._numbers)} | fields)

    def ask(self, kind: Callable[..., Message], **fields: Any) -> Any:
        """A question and its reply.

        Raises BrokenPromise if none comes.
        """
        asked = time.monotonic()
        request = self.request(kind, **fields)
        self.send(request)
        if not self._socket.poll(1000 * _PATIENCE):
            raise BrokenPromise(f"{request.type} is not answered within {_PATIENCE} s")
        self.frames = self._socket.recv_multipart()
        self.seconds = time.monotonic() - asked
        return decode(self.frames)

    def send(self, request: Message) -> None:
        """Send a request without waiting for its reply.

        Raises BrokenPromise if the message cannot be sent: the server has refused the connection.
        """
        try:
            self._socket.send_multipart(encode(request))
        except zmq.Again:
            raise BrokenPromise(f"{request.type} cannot be sent: the server takes nothing from this client") from None

    def receive(self, request: Message, seconds: float) -> Any:
        """Return the reply to this request, None if it does not come in time; other replies are skipped."""
        deadline = time.monotonic() + seconds
        while self._socket.poll(max(0, round(1000 * (deadline - time.monotonic())))):
            reply = decode([bytes(frame) for frame in self._socket.recv_multipart()])
            if (reply.client, reply.sequence) == (request.client, request.sequence):
                return reply
        return None

    def is_refused(self, requests: Sequence[Message]) -> bool:
        """Send requests and return whether the handshake is refused, so that none of them is answered."""
        with suppress(zmq.Again):  # refused already: there is no peer that one could wait for
            for request in requests:
                self._socket.send_multipart(encode(request), zmq.NOBLOCK)
        poller = zmq.Poller()
        poller.register(self._socket, zmq.POLLIN)
        poller.register(self._events, zmq.POLLIN)
        ready = dict(poller.poll(1000 * _PATIENCE))
        return self._events in ready and not self._socket.poll(100)

    def close(self) -> None:
        self._socket.disable_monitor()
        self._events.close()
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self.close()
