"""The line between the supervisor and a child: plain maps over a socket pair that keeps message boundaries."""

from __future__ import annotations

import contextlib
import select
import socket
from typing import Any

import msgpack

__all__ = ["Channel"]

#: One message: a header of the wire with an address and a little more.
_MESSAGE_BYTES = 128 * 1024


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
        """Send; False when the other end is gone."""
        try:
            self._line.send(msgpack.packb(message))
        except OSError:
            return False
        return True

    def offer(self, message: dict[str, Any]) -> bool:
        """Send unless the other end is behind with reading; False if it was not sent."""
        try:
            self._line.send(msgpack.packb(message), socket.MSG_DONTWAIT)
        except OSError:
            return False
        return True

    def pending(self) -> bool:
        """Whether :meth:`receive` would return at once."""
        return bool(select.select([self._line], [], [], 0)[0])

    def receive(self) -> dict[str, Any] | None:
        """Wait for a message; None when the other end is gone."""
        try:
            data = self._line.recv(2 * _MESSAGE_BYTES)
        except OSError:
            return None
        if not data:
            return None
        message: dict[str, Any] = msgpack.unpackb(data)
        return message

    def close(self) -> None:
        """Give the socket back."""
        self._line.close()
