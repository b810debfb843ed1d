"""How often something is tried again: so many times an hour, however long the server runs."""

from __future__ import annotations

from collections import deque

__all__ = ["Attempts"]

_SECONDS = 3600.0


class Attempts:
    """Starts of a child that may fall.

    Parameters
    ----------
    most : int
        Within an hour; who falls more often has a reason that starting again does not cure.
    """

    def __init__(self, most: int) -> None:
        self._made: deque[float] = deque(maxlen=most)

    def note(self, now: float) -> None:
        """One more, at this time of the monotonic clock."""
        self._made.append(now)

    def over(self, now: float) -> bool:
        """Whether there is none left."""
        return len(self._made) == self._made.maxlen and now - self._made[0] < _SECONDS
