"""One connection of a client to a server; every wait has a time limit."""

from __future__ import annotations

import time
import uuid
from collections.abc import Sequence

import zmq
import zmq.utils.monitor

from mesh_motion_conformance.wire import Message, read

__all__ = ["Ended", "Line", "Silence", "dealer"]


class Silence(Exception):
    """No reply within the time allowed."""


class Ended(Exception):
    """The server ended the connection."""


def dealer(endpoint: str, seconds: float) -> zmq.Socket[bytes]:
    """A DEALER socket for this endpoint, not yet connected, whose calls last at most the given time."""
    socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
    socket.setsockopt(zmq.LINGER, 0)
    for option in (zmq.SNDTIMEO, zmq.RCVTIMEO):
        socket.setsockopt(option, round(1000 * seconds))
    socket.setsockopt(zmq.IPV6, int("[" in endpoint))
    return socket


class Line:
    """A DEALER socket to one endpoint.

    Parameters
    ----------
    seconds : float
        The longest wait for a reply.

    Attributes
    ----------
    client : bytes
        A new UUID.
    sequence : int
        Number of the last request.
    """

    def __init__(self, endpoint: str, seconds: float) -> None:
        self.endpoint = endpoint
        self.seconds = seconds
        self.client = uuid.uuid4().bytes
        self.sequence = 0
        self._socket = dealer(endpoint, seconds)
        self._events: zmq.Socket[bytes] = self._socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        self._socket.connect(endpoint)

    def next(self) -> int:
        """The number of the next request."""
        self.sequence += 1
        return self.sequence

    def send(self, frames: Sequence[bytes]) -> None:
        """Send one multipart message; :class:`Ended` if this side has closed the connection."""
        if self.closed:
            raise Ended("the connection is closed")
        self._socket.send_multipart(list(frames))

    def send_part(self, frame: bytes) -> None:
        """Send a frame that is not the last of its message."""
        self._socket.send(frame, zmq.SNDMORE)

    def receive(self, seconds: float | None = None) -> Message:
        """The next message, or one of the errors Silence, Ended and Malformed."""
        deadline = time.monotonic() + (self.seconds if seconds is None else seconds)
        poller = zmq.Poller()
        poller.register(self._socket, zmq.POLLIN)
        poller.register(self._events, zmq.POLLIN)
        while True:
            left = max(0.0, deadline - time.monotonic())
            ready = dict(poller.poll(round(1000 * left) + 1))
            if self._socket in ready:
                return read(self._socket.recv_multipart())
            if self._events in ready:
                zmq.utils.monitor.recv_monitor_message(self._events)
                raise Ended("the server ended the connection")
            if left <= 0:
                raise Silence(f"no reply within {self.seconds if seconds is None else seconds:g} s")

    def pending(self) -> bool:
        """True if there is an unread message."""
        return bool(self._socket.poll(0))

    @property
    def closed(self) -> bool:
        """Whether :meth:`close` was called."""
        return bool(self._socket.closed)

    def close(self) -> None:
        """Cut the connection; idempotent."""
        if not self._socket.closed:
            self._socket.disable_monitor()
            self._events.close()
            self._socket.close()
