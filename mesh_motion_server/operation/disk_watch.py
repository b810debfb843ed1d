"""The free room on the disk, read in a thread: if a disk does not answer (a network mount without its server), only
that thread is blocked.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

from mesh_motion_protocol.errors import ResourceExhausted

from mesh_motion_server.operation.room import DiskRoom, disk_room

#: A disk that has not answered for this long, seconds, gets no further requests, because they would block. Disks that
#: wake up, and mounts that fail over, take some seconds.
SILENT_SECONDS = 5.0
#: A request for the current room waits this long, seconds. A healthy disk takes microseconds, but on a machine with ten
#: times as much work as cores the thread may wait for more than a second.
_FRESH_SECONDS = SILENT_SECONDS


class DiskWatch:
    """The last answer of the disk with the state folder, and the time since the open question.

    Parameters
    ----------
    look : callable, optional
        Folder → room.
    """

    def __init__(self, folder: Path, look: Callable[[Path], DiskRoom] = disk_room) -> None:
        self._folder = folder
        self._look = look
        self._room = DiskRoom(0, 0, False)
        self._asked_at: float | None = None
        self._answered = threading.Event()

    @property
    def room(self) -> DiskRoom:
        """The last answer; nothing before the first one."""
        return self._room

    def ask(self) -> None:
        """Start a question unless the last one is still open; return at once."""
        if self._asked_at is not None:
            return
        self._answered.clear()
        self._asked_at = time.monotonic()
        try:
            threading.Thread(target=self._wait_for_it, name="disk", daemon=True).start()
        except RuntimeError:
            self._asked_at = None  # without memory for a thread, the last answer is kept
            self._answered.set()

    def _wait_for_it(self) -> None:
        self._room = self._look(self._folder)
        self._asked_at = None
        self._answered.set()

    def silence(self) -> float:
        """Seconds since the open question was asked."""
        asked_at = self._asked_at
        return 0.0 if asked_at is None else time.monotonic() - asked_at

    def fresh(self) -> DiskRoom:
        """Return the current room. Raises ResourceExhausted: RESOURCE_EXHAUSTED.DISK if the disk does not answer."""
        self.ask()
        if not self._answered.wait(max(0.0, _FRESH_SECONDS - self.silence())):
            raise _no_answer()
        return self._room

    def require_answers(self) -> None:
        """Raise RESOURCE_EXHAUSTED.DISK if the disk has not answered for too long."""
        if self.silence() > SILENT_SECONDS:
            raise _no_answer()


def _no_answer() -> ResourceExhausted:
    return ResourceExhausted(
        "the disk of the state folder does not answer",
        code="RESOURCE_EXHAUSTED.DISK",
        hint="check the server's disk or network mount, then try again",
    )
