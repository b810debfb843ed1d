"""A session's history, read as it grows, piece by piece: a long one takes a while, its end is shown meanwhile."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from mesh_motion_server.watch.observation.follow import EventTail
from mesh_motion_server.watch.page.followed import Followed

__all__ = ["Reading"]

#: A question waits for so much reading at most, seconds; others are answered in between.
_SECONDS = 0.7
_PIECE = 4 << 20
#: The end of a history that is longer is read before the whole.
_LATEST = 8 << 20


class Reading:
    """One session.

    Parameters
    ----------
    folder : Path
        The session's.
    """

    def __init__(self, folder: Path) -> None:
        self._tail, self._whole = EventTail(folder), Followed()
        self._length = self._tail.behind()
        self._end, self._latest = self._tail, self._whole
        if self._length > _LATEST:
            self._end, self._latest = EventTail(folder, last_bytes=_LATEST), Followed()

    @property
    def stamp(self) -> tuple[int, int]:
        """Another one when what is known has changed."""
        return self._whole.events, self._latest.events

    def catch_up(self) -> None:
        """Read what has come, for so long at most."""
        deadline = time.monotonic() + _SECONDS
        while events := self._end.read(_PIECE, brief=True):
            self._latest.take(events)
        while self._latest is not self._whole and (events := self._tail.read(_PIECE, brief=True)):
            self._whole.take(events)
            if time.monotonic() >= deadline:
                return
        self._end, self._latest = self._tail, self._whole

    def detail(self) -> dict[str, Any]:
        """All but the series; ``read`` is which part of the history is known, 1 if all of it."""
        whole = self._latest is self._whole
        share = 1.0 if whole else min(0.99, round(1.0 - self._tail.behind() / self._length, 2))
        return self._latest.detail() | {"built": self._whole.built, "read": share}

    def series(self, first: int | None, last: int | None, points: int) -> dict[str, Any]:
        """The steps first … last as columns; as long as not all is read, of the latest steps."""
        return self._latest.series(first, last, points)
