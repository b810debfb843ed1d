"""Replies that are sent so long after the question, whatever there was to look up: their time tells nothing."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

__all__ = ["LateReplies"]

#: Longer than looking a session up takes.
_SECONDS = 0.05
#: Waiting for sockets ends up to a millisecond late, counted from when the wait began: a reply that is sent then tells
#: how long the lookup before it took. So the wait ends this early, and the rest is slept to the microsecond.
_ROUNDING_SECONDS = 0.002


class LateReplies:
    """Keeps replies until they are due.

    Parameters
    ----------
    send : callable
        Peer and frame → to the gateway.

    Attributes
    ----------
    waiting : deque of (float, bytes, bytes)
        When each is due, monotonic seconds; its peer and frame. The first one is due first.
    """

    def __init__(self, send: Callable[[bytes, bytes], None]) -> None:
        self._send = send
        self._asked_at = 0.0
        self.waiting: deque[tuple[float, bytes, bytes]] = deque()

    def asked(self) -> None:
        """A question has come: what is put from now on is its reply."""
        self._asked_at = time.monotonic()

    def put(self, peer: bytes, frame: bytes) -> None:
        """Send it when it is due."""
        self.waiting.append((self._asked_at + _SECONDS, peer, frame))

    def send_due(self, now: float) -> None:
        """Send what is due, or next to it."""
        while self.waiting and self.waiting[0][0] - now <= _ROUNDING_SECONDS:
            due, peer, frame = self.waiting.popleft()
            time.sleep(max(0.0, due - time.monotonic()))
            self._send(peer, frame)

    def next_due(self) -> float | None:
        """When :meth:`send_due` will have something to do."""
        return self.waiting[0][0] - _ROUNDING_SECONDS if self.waiting else None
