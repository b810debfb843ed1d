"""Writes a session's history; no failure here reaches the session."""

import logging
import os
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from mesh_motion_server.absence import is_missing
from mesh_motion_server.session.history.boundary import (
    BOUNDARY,
    cut_torn_record,
    digest_at,
    pack_input,
    pack_maker,
    pack_outcome,
    pack_taken_up,
    pack_time,
)
from mesh_motion_server.session.history.events import EVENTS, FOLDER, end_torn_line, kept_of, last_committed, line_of
from mesh_motion_server.session.history.segments import Full, Segments, list_segments, require_room
from mesh_motion_server.session.journal.ledger import BoundaryInput

_LOG = logging.getLogger(__name__)

#: Size of a segment.
_SEGMENT = 16 << 20
#: Share of the granted bytes for the events (one quarter), and their smallest number of segments.
_EVENTS_PART, _LEAST_SEGMENTS = 4, 4
#: Multiple of the reserve at which the history stops: twice the level at which the log warns, so it stops first.
_RESERVES = 4
_MISSING = "steps before it are missing"


class History:
    """The history of one session, written by the process that holds it.

    No method ever raises: the first failure ends the history with one warning, until the session is resumed.

    Parameters
    ----------
    folder : Path
        The session's folder. If it does not exist, as in file system models of tests, there is no history.
    total_bytes : int
        0: no history.
    reserve_bytes : int
        Below this free space no session is opened; below four times this value no file of the history is started.
    """

    def __init__(self, folder: Path, total_bytes: int, reserve_bytes: int = 0) -> None:
        self._session = folder
        self._total, self._reserve = total_bytes, _RESERVES * reserve_bytes
        self._events: Segments | None = None
        self._boundary: Segments | None = None
        self._over = not total_bytes
        self._boundary_over = False
        self._next, self._why = 1, _MISSING
        self._maker = ""

    def begin_again(self) -> None:
        """After a resume, start a history again that a failure has ended."""
        self.close()
        self._over, self._boundary_over, self._maker = not self._total, False, ""

    # --- what is recorded ------------------------------------------------------------------------------------------

    def record(self, event: str, **values: Any) -> None:
        """Add an event."""
        self.attempt(lambda: self._write_event(event, values))

    def record_input(
        self, step: int, boundary: Callable[[], BoundaryInput], dimension: int, time: float | None = None
    ) -> None:
        """Record the input of the next commit, and the time of its step, if any."""
        if not self._boundary_over:
            self.attempt(lambda: self._write_input(step, boundary, dimension, time))

    def record_outcome(self, step: int, digest: bytes) -> None:
        """Record the digest of a committed state."""
        if not self._boundary_over:
            self.attempt(lambda: self._write_boundary(pack_outcome(step, digest), step + 1))

    def take_up(self, step: int, digest: bytes) -> None:
        """The session continues at a committed step; its digest shows whether the boundary log continues there."""
        self.attempt(lambda: self._take_up(step, digest))

    def attempt(self, write: Callable[[], None]) -> None:
        """Call ``write`` unless the history has ended; a failure ends it."""
        if self._over:
            return
        try:
            if self._events is None and is_missing(self._session):
                self._over = True
                return
            write()
        except Exception as error:
            self.close()
            with suppress(Exception):  # for example no memory for the line
                reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else error
                _LOG.warning("the history of session %s ends, the session goes on: %s", self._session.name, reason)

    def last_step(self) -> tuple[bool, int]:
        """Whether anything is recorded yet, and the last step recorded as committed; (True, 0) after its end."""
        found = (True, 0)

        def look() -> None:
            nonlocal found
            found = last_committed(self._session)

        self.attempt(look)
        return found

    def close(self) -> None:
        """Close the files and record nothing more. Idempotent."""
        self._over = True
        for segments in (self._events, self._boundary):
            if segments is not None:
                with suppress(OSError):
                    segments.close()
        self._events = self._boundary = None

    # --- inside ----------------------------------------------------------------------------------------------------

    def _write_event(self, event: str, values: Mapping[str, Any]) -> None:
        if self._events is None:
            total = self._total // _EVENTS_PART
            self._events = self._open(EVENTS, min(_SEGMENT, total // _LEAST_SEGMENTS), total, end_torn_line)
        self._events.append(line_of(time.time(), event, values), forget=True)

    def _write_input(
        self, step: int, boundary: Callable[[], BoundaryInput], dimension: int, seconds: float | None
    ) -> None:
        if step > self._next:
            self._end_boundary(step, self._why)
            return
        self._next = step + 1
        found = boundary()
        if found.maker != self._maker:
            self._maker = found.maker
            self._write_boundary(pack_maker(step, found.maker), step)
        if not self._boundary_over:
            self._write_boundary(pack_input(step, found.frame, found.rows, 8 * dimension), step)
        if seconds is not None and not self._boundary_over:
            self._write_boundary(pack_time(step, seconds), step)

    def _take_up(self, step: int, digest: bytes) -> None:
        found = digest_at(self._session, step) if step else b""
        self._next = step + 1 if found == digest or not step else 0
        self._why = "the recorded steps before it are not those of the session" if found else _MISSING
        if list_segments(self._session / FOLDER, BOUNDARY):
            self._write_boundary(pack_taken_up(step), step + 1)

    def _write_boundary(self, record: bytes, step: int) -> None:
        if self._boundary is None:
            total = self._total - self._total // _EVENTS_PART
            self._boundary = self._open(BOUNDARY, _SEGMENT, total, cut_torn_record)
        try:
            self._boundary.append(record, forget=False)
        except Full:
            self._end_boundary(step, f"its part of history_bytes = {self._total} is used")

    def _end_boundary(self, step: int, why: str) -> None:
        """End the boundary log: steps after a gap cannot be replayed."""
        self._boundary_over = True
        if self._boundary is not None:
            self._boundary.close()
        message = f"the boundary is not recorded from step {step} on: {why}"
        self._write_event("boundary_ended", {"step": step, "message": message})

    def _open(self, kind: str, segment_bytes: int, total_bytes: int, mend: Callable[[int], None]) -> Segments:
        folder = self._session / FOLDER
        if is_missing(folder):
            require_room(self._session, self._reserve)  # first, so that no empty folder is made on a full disk
            folder.mkdir(mode=0o700)
        return Segments(
            folder,
            kind,
            segment_bytes=segment_bytes,
            total_bytes=total_bytes,
            reserve_bytes=self._reserve,
            mend=mend,
            keep=kept_of if kind == EVENTS else _nothing,
        )


def _nothing(_: Path) -> bytes:
    """Keep nothing: no segment of a boundary log is removed."""
    return b""
