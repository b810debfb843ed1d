"""Divides the bytes of a ZMTP 3 connection (ZeroMQ RFC 23) into units: parts of the greeting, commands, whole messages.

Each side waits for the other's signature before it sends the rest of its greeting, so every part of the greeting is a
unit at once.

With CURVE each frame is one unit, because the boundaries of messages are encrypted.
"""

from collections.abc import Iterator

_GREETING_BYTES = 64
_FLAG_MORE, _FLAG_LONG, _FLAG_COMMAND = 1, 2, 4


class Stream:
    """One direction of one connection.

    ``rest``: received bytes of an incomplete unit.
    """

    def __init__(self) -> None:
        self.rest = b""
        self._greeting_left = _GREETING_BYTES

    def feed(self, data: bytes) -> Iterator[tuple[str, bytes]]:
        """Return the units that are complete now, as ("greeting" | "command" | "message", bytes)."""
        self.rest += data
        while end := self._end():
            kind = self._kind()
            unit, self.rest = self.rest[:end], self.rest[end:]
            self._greeting_left -= min(end, self._greeting_left)
            yield kind, unit

    def _kind(self) -> str:
        if self._greeting_left:
            return "greeting"
        return "command" if self.rest[0] & _FLAG_COMMAND else "message"

    def _end(self) -> int:
        """Size of the first unit in bytes, 0 while it is incomplete."""
        if self._greeting_left:
            return min(self._greeting_left, len(self.rest))
        at = 0
        while at < len(self.rest):
            flags = self.rest[at]
            head = 9 if flags & _FLAG_LONG else 2
            size = int.from_bytes(self.rest[at + 1 : at + head], "big")
            at += head + size
            if at > len(self.rest):
                return 0
            if not flags & _FLAG_MORE:
                return at
        return 0
