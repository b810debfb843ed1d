"""Read a session's events as they are written; handles new segments, removed segments and incomplete lines."""

import re
from collections.abc import Container, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from mesh_motion_server.session.history.events import EVENTS, FOLDER, lines_backwards, parse_line
from mesh_motion_server.session.history.segments import list_segments

#: A line begins with its time and kind.
_HEAD = 80
#: A table of cells: objects without nested objects.
_WORST = re.compile(rb'"worst": ?\[(?:\{[^{}]*\},? ?)*\]')


class EventTail:
    """Reads what has been added since the last time.

    Parameters
    ----------
    session_folder : Path
        Need not exist yet.
    last_bytes : int, optional
        Begin at a line, at most this many bytes before the current end; if omitted, at the beginning.
    """

    def __init__(self, session_folder: Path, last_bytes: int | None = None) -> None:
        self._folder = session_folder / FOLDER
        self._path: Path | None = None
        self._offset = 0
        for path in reversed(self._segments() if last_bytes is not None else []):
            self._path, self._offset = path, _line_before_end(path, last_bytes or 0)
            last_bytes = (last_bytes or 0) - _size(path)
            if last_bytes <= 0:
                break

    def behind(self) -> int:
        """Number of bytes that are not read yet."""
        left = [path for path in self._segments() if self._path is None or path >= self._path]
        return sum(map(_size, left)) - (self._offset if self._path in left else 0)

    def read(self, most_bytes: int = 16 << 20, *, brief: bool = False) -> list[dict[str, Any]]:
        """The next events, oldest first: at most this many bytes, or one line; empty if there is nothing new.

        ``brief`` empties the worst cells' tables, except in the latest returned ``moved`` and ``committed``: the tables
        are two thirds of a history, and reading them takes more than half the time.
        """
        events: list[dict[str, Any]] = []
        while most_bytes > 0 and (path := self._current()) is not None:
            data = self._next_lines(path, most_bytes)
            if not data and not self._over(path):
                break
            lines = _in_brief(data.splitlines()) if brief else data.splitlines()
            events += [event for line in lines if (event := parse_line(line)) is not None]
            most_bytes -= len(data)
        return events

    def _current(self) -> Path | None:
        """The segment to read: the oldest remaining one that is not read."""
        if self._path is None or not self._path.exists():
            segments = self._segments()
            # the newest segment is never removed alone: if only lower numbers exist, the history has restarted
            later = [path for path in segments if self._path is None or path > self._path] or segments
            if not later:
                return None
            self._path, self._offset = later[0], 0
        return self._path

    def _next_lines(self, path: Path, most: int) -> bytes:
        """Whole lines from the offset on."""
        try:
            with path.open("rb") as file:
                if file.seek(0, 2) < self._offset:  # another file of the same name: the history has restarted
                    self._offset = 0
                file.seek(self._offset)
                data = file.read(most)
                if b"\n" not in data and len(data) == most:
                    data += file.readline()
        except FileNotFoundError:
            return b""
        data = data[: data.rfind(b"\n") + 1]
        self._offset += len(data)
        return data

    def _over(self, path: Path) -> bool:
        """Whether the segment is read to its end and a newer segment exists, which is then read next."""
        later = [other for other in self._segments() if other > path]
        if not later or self._has_more(path):
            return bool(later)
        self._path, self._offset = later[0], 0
        return True

    def _has_more(self, path: Path) -> bool:
        """Whether lines were added after the last read and before the next segment began."""
        try:
            with path.open("rb") as file:
                file.seek(self._offset)
                return b"\n" in file.read()
        except FileNotFoundError:
            return False

    def _segments(self) -> list[Path]:
        return list_segments(self._folder, EVENTS)


def _in_brief(lines: list[bytes]) -> list[bytes]:
    """The lines with empty tables of worst cells; the last line of each kind is unchanged."""
    whole = {
        next((k for k in range(len(lines) - 1, -1, -1) if kind in lines[k][:_HEAD]), -1)
        for kind in (b'"moved"', b'"committed"')
    }
    return [line if k in whole else _WORST.sub(b'"worst":[]', line) for k, line in enumerate(lines)]


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0  # the oldest may be removed at any time


def _line_before_end(path: Path, most: int) -> int:
    """Start of a line that is at most this many bytes before the file's end."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            if size <= most:
                return 0
            file.seek(size - most)
            file.readline()
            return file.tell()
    except FileNotFoundError:
        return 0


def events_in_brief(session_folder: Path) -> Iterator[dict[str, Any]]:
    """All events, oldest first, most of them without their worst cells: see :meth:`EventTail.read`."""
    tail = EventTail(session_folder)
    while events := tail.read(brief=True):
        yield from events


def last_event(
    session_folder: Path, kinds: Container[str] | None = None, step: int | None = None
) -> dict[str, Any] | None:
    """The latest complete event, optionally only of these kinds, and of this step; None if there is none."""
    for path in reversed(list_segments(session_folder / FOLDER, EVENTS)):
        with suppress(FileNotFoundError), path.open("rb") as file:
            for line in lines_backwards(file):
                event = parse_line(line)
                if event is None:
                    continue
                if step is not None and event.get("step", step) < step:
                    return None  # all other lines are older
                if (kinds is None or event["event"] in kinds) and step in (None, event.get("step")):
                    return event
    return None
