"""The line between the supervisor and a child: plain maps over a socket pair that keeps message boundaries.

Nobody waits for the other end without a bound. The supervisor never waits at all: it offers, and what is not taken is
kept (:class:`Outbox`), told later, or said to the client. A child that must be heard waits for some seconds.
"""

from __future__ import annotations

import contextlib
import select
import socket
import struct
from collections import deque
from typing import Any

import msgpack

__all__ = ["Channel", "Outbox"]

#: One message: a header of the wire with an address and a little more.
_MESSAGE_BYTES = 128 * 1024
#: A child waits so long for a supervisor that does not read, seconds: longer than that takes for anything.
_SEND_SECONDS = 30


class Channel:
    """One end of the line.

    Parameters
    ----------
    line : socket.socket
        A connected ``SOCK_SEQPACKET`` socket, owned from now on.
    """

    def __init__(self, line: socket.socket) -> None:
        self._line = line
        with contextlib.suppress(OSError):
            line.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4 * _MESSAGE_BYTES)
        line.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("@ll", _SEND_SECONDS, 0))

    @classmethod
    def pair(cls) -> tuple[Channel, socket.socket]:
        """This process' end and the socket whose file descriptor a child inherits."""
        here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        return cls(here), there

    @classmethod
    def inherited(cls, descriptor: int) -> Channel:
        """The child's end."""
        return cls(socket.socket(fileno=descriptor))

    def fileno(self) -> int:
        """For selectors and pollers."""
        return self._line.fileno()

    def send(self, message: dict[str, Any]) -> bool:
        """Send, if need be after some seconds; False when the other end is gone or does not read."""
        return self._sent(message, 0)

    def offer(self, message: dict[str, Any]) -> bool:
        """Send unless the other end is gone or behind with reading; False if it was not sent. Never waits."""
        return self._sent(message, socket.MSG_DONTWAIT)

    def _sent(self, message: dict[str, Any], flags: int) -> bool:
        try:
            self._line.send(msgpack.packb(message), flags)
        except OSError:
            return False
        return True

    def pending(self, seconds: float = 0.0) -> bool:
        """Whether :meth:`receive` returns at once, within this time."""
        poll = select.poll()
        poll.register(self._line, select.POLLIN)
        return bool(poll.poll(1000 * seconds))

    def receive(self, seconds: float | None = None) -> dict[str, Any] | None:
        """Wait for a message; None when the other end is gone, or has said nothing within ``seconds``, or nonsense."""
        if seconds is not None and not self.pending(seconds):
            return None
        try:
            data = self._line.recv(2 * _MESSAGE_BYTES)
        except OSError:
            return None
        if not data:
            return None
        try:
            message: dict[str, Any] = msgpack.unpackb(data)
        except ValueError:
            return None  # too long, or no message: whoever says such things is as good as gone
        return message

    def hand_over(self, line: socket.socket) -> None:
        """Pass a socket on without waiting; if the other end is gone or behind, the socket's peer reads its end."""
        with contextlib.suppress(OSError):
            socket.send_fds(self._line, [b"line"], [line.fileno()], socket.MSG_DONTWAIT)

    def take_over(self) -> Channel | None:
        """Wait for a socket that is handed over; None when the other end is gone."""
        _, descriptors, _, _ = socket.recv_fds(self._line, _MESSAGE_BYTES, 1)
        return Channel.inherited(descriptors[0]) if descriptors else None

    def close(self) -> None:
        """Give the socket back."""
        self._line.close()


class Outbox:
    """What an end that is behind with reading gets once it reads again.

    Parameters
    ----------
    channel : Channel
    most : int
        Messages that are kept; further ones are refused.
    """

    def __init__(self, channel: Channel, most: int) -> None:
        self._channel = channel
        self._most = most
        self._kept: deque[dict[str, Any]] = deque()

    def __len__(self) -> int:
        return len(self._kept)

    def put(self, message: dict[str, Any]) -> bool:
        """Send behind what is kept, or keep; False if there is no room."""
        if not self._kept and self._channel.offer(message):
            return True
        if len(self._kept) >= self._most:
            return False
        self._kept.append(message)
        return True

    def flush(self) -> None:
        """Send what the other end takes."""
        while self._kept and self._channel.offer(self._kept[0]):
            self._kept.popleft()
