"""Replies with a fixed delay after the question, so that their time does not show what was looked up."""

import time
from collections import deque
from collections.abc import Callable

#: Longer than a lookup of a session takes.
_SECONDS = 0.05
#: A wait for sockets ends up to a millisecond late, counted from its start, so the time of the reply would show how
#: long the lookup took. So the wait ends this much earlier, and a sleep accurate to the microsecond covers the rest.
_ROUNDING_SECONDS = 0.002


class LateReplies:
    """Keeps replies until they are due.

    Parameters
    ----------
    send : callable
        Peer and frame → sent to the gateway.

    Attributes
    ----------
    waiting : deque of (float, bytes, bytes)
        Due time in monotonic seconds, peer and frame; in order of the due time.
    """

    def __init__(self, send: Callable[[bytes, bytes], None]) -> None:
        self._send = send
        self._asked_at = 0.0
        self.waiting: deque[tuple[float, bytes, bytes]] = deque()

    def asked(self) -> None:
        """Note the time of a question; the next :meth:`put` is its reply."""
        self._asked_at = time.monotonic()

    def put(self, peer: bytes, frame: bytes) -> None:
        """Send the reply when it is due."""
        self.waiting.append((self._asked_at + _SECONDS, peer, frame))

    def send_due(self, now: float) -> None:
        """Send the replies that are due, or due within the rounding time."""
        while self.waiting and self.waiting[0][0] - now <= _ROUNDING_SECONDS:
            due, peer, frame = self.waiting.popleft()
            time.sleep(max(0.0, due - time.monotonic()))
            self._send(peer, frame)

    def next_due(self) -> float | None:
        """Return when :meth:`send_due` must run next."""
        return self.waiting[0][0] - _ROUNDING_SECONDS if self.waiting else None
