"""The line between the supervisor and a child: plain maps over a socket pair that keeps message boundaries.

No end waits for the other without a time limit. The supervisor never waits: it offers a message, and if the other end
does not accept it, the supervisor keeps it (:class:`Outbox`), sends it later, or reports this to the client. A child
whose message must arrive waits some seconds.
"""

from __future__ import annotations

import contextlib
import select
import socket
import struct
from collections import deque
from typing import Any

import msgpack

#: Largest message: a header of the protocol with an address and a little more.
_MESSAGE_BYTES = 128 * 1024
#: Seconds that a child waits for a supervisor that does not read; longer than any work of the supervisor takes.
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
        """Return this process' end and the socket whose file descriptor a child inherits."""
        here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        return cls(here), there

    @classmethod
    def inherited(cls, descriptor: int) -> Channel:
        """Return the child's end."""
        return cls(socket.socket(fileno=descriptor))

    def fileno(self) -> int:
        """Return the file descriptor, for selectors and pollers."""
        return self._line.fileno()

    def send(self, message: dict[str, Any]) -> bool:
        """Send, after a wait of some seconds if necessary; False if the other end is gone or does not read."""
        return self._sent(message, 0)

    def offer(self, message: dict[str, Any]) -> bool:
        """Send without waiting; False if the other end is gone or its queue is full."""
        return self._sent(message, socket.MSG_DONTWAIT)

    def _sent(self, message: dict[str, Any], flags: int) -> bool:
        try:
            self._line.send(msgpack.packb(message), flags)
        except OSError:
            return False
        return True

    def pending(self, seconds: float = 0.0) -> bool:
        """Return whether a message can be received within this time."""
        poll = select.poll()
        poll.register(self._line, select.POLLIN)
        return bool(poll.poll(1000 * seconds))

    def receive(self, seconds: float | None = None) -> dict[str, Any] | None:
        """Wait for a message; None if the other end is gone, silent for ``seconds``, or sends no valid message."""
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
            return None  # too long or not a valid message: treat the sender as gone
        return message

    def hand_over(self, line: socket.socket) -> None:
        """Pass a socket on without waiting; if the other end does not take it, the socket's peer sees a closed line."""
        with contextlib.suppress(OSError):
            socket.send_fds(self._line, [b"line"], [line.fileno()], socket.MSG_DONTWAIT)

    def take_over(self) -> Channel | None:
        """Wait for a socket from the other end; None if the other end is gone."""
        _, descriptors, _, _ = socket.recv_fds(self._line, _MESSAGE_BYTES, 1)
        return Channel.inherited(descriptors[0]) if descriptors else None

    def close(self) -> None:
        """Close the socket."""
        self._line.close()


class Outbox:
    """Keeps messages for an end that is slow to read, and sends them when it reads again.

    Parameters
    ----------
    most : int
        Largest number of kept messages; further ones are refused.
    """

    def __init__(self, channel: Channel, most: int) -> None:
        self._channel = channel
        self._most = most
        self._kept: deque[dict[str, Any]] = deque()

    def __len__(self) -> int:
        return len(self._kept)

    def put(self, message: dict[str, Any]) -> bool:
        """Send after the kept messages, or keep this one too; False if there is no room."""
        if not self._kept and self._channel.offer(message):
            return True
        if len(self._kept) >= self._most:
            return False
        self._kept.append(message)
        return True

    def flush(self) -> None:
        """Send as many kept messages as the other end accepts."""
        while self._kept and self._channel.offer(self._kept[0]):
            self._kept.popleft()
