"""Read a session's history in pieces while it grows; the end of a long history is shown until all is read."""

import time
from pathlib import Path
from typing import Any

from mesh_motion_server.watch.observation.follow import EventTail
from mesh_motion_server.watch.observation.followed import Followed

#: Maximum seconds of reading for one request; other requests are answered in between.
_SECONDS = 0.7
#: Bytes read between two checks of the time.
_PIECE = 4 << 20
#: If a history is longer, its end is read first.
_LATEST = 8 << 20


class Reading:
    """The history of one session.

    Parameters
    ----------
    folder : Path
        The session's.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._tail, self._whole = EventTail(folder), Followed()
        self._length = self._tail.behind()
        self._end, self._latest = self._tail, self._whole
        if self._length > _LATEST:
            self._end, self._latest = EventTail(folder, last_bytes=_LATEST), Followed()

    @property
    def stamp(self) -> tuple[int, int]:
        """A stamp that changes when the known data change."""
        return self._whole.events, self._latest.events

    def catch_up(self) -> None:
        """Read new events, for a limited time."""
        deadline = time.monotonic() + _SECONDS
        while events := self._end.read(_PIECE, brief=True):
            self._latest.take(events)
        while self._latest is not self._whole and (events := self._tail.read(_PIECE, brief=True)):
            self._whole.take(events)
            if time.monotonic() >= deadline:
                return
        self._end, self._latest = self._tail, self._whole

    def detail(self) -> dict[str, Any]:
        """All data except the series, and ``folder``; ``read`` is the known share of the history, 1 if complete."""
        whole = self._latest is self._whole
        share = 1.0 if whole else min(0.99, round(1.0 - self._tail.behind() / self._length, 2))
        return self._latest.detail() | {"built": self._whole.built, "read": share, "folder": str(self._folder)}

    def series(self, first: int | None, points: int) -> dict[str, Any]:
        """The steps from ``first`` on as columns; until everything is read, only the latest steps."""
        return self._latest.series(first, points)
