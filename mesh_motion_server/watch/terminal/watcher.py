"""A thread that looks at a source again and again, so that a slow disk or server never holds up the keys."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from mesh_motion_server.watch.terminal.sources import Details, SessionLine, Source, Unreadable

__all__ = ["Look", "Watcher"]

#: How long a history is read before what is known of it is shown, seconds.
_READ_SECONDS = 0.3
#: The list is made anew after so many times what making it takes: a thousand sessions must not keep a disk busy.
_REST = 10.0
_LONGEST_STOP = 1.0


@dataclass(frozen=True, eq=False)
class Look:
    """What was found.

    Attributes
    ----------
    lines : list of SessionLine
    session : str
        The one that ``details`` are of.
    details : Details or None
    verdict : str
    trouble : str
        Why there is nothing new; empty: all is well.
    """

    lines: list[SessionLine] = field(default_factory=list)
    session: str = ""
    details: Details | None = None
    verdict: str = ""
    trouble: str = ""


class Watcher:
    """Looks every so many seconds, at once when another session is chosen, and without a pause while it reads.

    Parameters
    ----------
    source : Source
        Used by the thread alone.
    tell : callable
        Called in the thread with each :class:`Look`.
    every : float
        Seconds.
    """

    def __init__(self, source: Source, tell: Callable[[Look], None], every: float = 1.0) -> None:
        self._source, self._tell, self._every = source, tell, every
        self._chosen = ""
        self._wake, self._stop = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="watcher", daemon=True)

    def start(self) -> None:
        """Begin to look."""
        self._thread.start()

    def choose(self, session: str) -> None:
        """Of which session details are wanted."""
        if session != self._chosen:
            self._chosen = session
            self._wake.set()

    def stop(self) -> None:
        """End; waits a moment for a look that is under way."""
        self._stop.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join(_LONGEST_STOP)

    def _run(self) -> None:
        lines: list[SessionLine] = []
        due, verdict, trouble = 0.0, "", ""
        while not self._stop.is_set():
            self._wake.clear()
            begin = time.monotonic()
            if begin >= due:
                try:
                    lines, trouble = self._source.sessions(), ""
                    verdict = self._source.verdict(lines)
                except Exception as error:
                    lines, trouble = [], _said(error)
                due = time.monotonic() + max(self._every, _REST * (time.monotonic() - begin)) - 0.01
            look = self._look(lines, verdict, trouble)
            if self._stop.is_set():
                break
            self._tell(look)
            reads = look.details is not None and look.details.share_read < 1.0
            self._wake.wait(0.0 if reads else self._every)
        self._source.close()

    def _look(self, lines: list[SessionLine], verdict: str, trouble: str) -> Look:
        """With the details of the session that is chosen, else of the first."""
        names = [line.session for line in lines]
        session = self._chosen if self._chosen in names else names[0] if names else ""
        details = None
        if session:
            try:
                details = self._source.details(session, _READ_SECONDS)
            except Exception as error:
                trouble = _said(error)
        return Look(lines, session, details, verdict, trouble)


def _said(error: Exception) -> str:
    """What is told of an error: whatever it is, a thread that ended with it would leave a view that stands still."""
    return str(error) if isinstance(error, Unreadable) else f"it cannot be read: {str(error) or type(error).__name__}"
