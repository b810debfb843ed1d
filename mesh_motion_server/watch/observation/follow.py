"""A session's events as they come: survives the change of segments, their removal, and torn lines."""

from __future__ import annotations

import re
from collections.abc import Container, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from mesh_motion_server.session.history.events import EVENTS, FOLDER, lines_backwards, parse_line
from mesh_motion_server.session.history.segments import list_segments

__all__ = ["EventTail", "events_in_brief", "events_naming", "last_event"]

#: A line begins with when and what.
_HEAD = 80
#: A table of cells: objects that hold none themselves.
_WORST = re.compile(rb'"worst": ?\[(?:\{[^{}]*\},? ?)*\]')


class EventTail:
    """Reads what has been added since the last time.

    Parameters
    ----------
    session_folder : Path
        Need not exist yet.
    last_bytes : int, optional
        Begin so far before the end of what is there now, at a line; without it at the beginning.
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
        """How many bytes there are that were not read yet."""
        left = [path for path in self._segments() if self._path is None or path >= self._path]
        return sum(map(_size, left)) - (self._offset if self._path in left else 0)

    def read(self, most_bytes: int = 16 << 20, *, brief: bool = False) -> list[dict[str, Any]]:
        """The next events, oldest first, of so many bytes at most or one line; none when there is nothing new.

        ``brief`` leaves the worst cells' tables empty but in the latest ``moved`` and ``committed`` of those that are
        returned: they are two thirds of a history, and cost more than half the time that it takes to be read.
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
        """The segment that is being read: the oldest one that is left of those not read."""
        if self._path is None or not self._path.exists():
            segments = self._segments()
            # the newest is never taken away alone: where only lower numbers are there, the history was begun anew
            later = [path for path in segments if self._path is None or path > self._path] or segments
            if not later:
                return None
            self._path, self._offset = later[0], 0
        return self._path

    def _next_lines(self, path: Path, most: int) -> bytes:
        """Whole lines from the offset on."""
        try:
            with path.open("rb") as file:
                if file.seek(0, 2) < self._offset:  # another file of the same name: the history was begun anew
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
        """Whether the segment is read to its end and another one was begun; that one is then the next."""
        later = [other for other in self._segments() if other > path]
        if not later or self._has_more(path):
            return bool(later)
        self._path, self._offset = later[0], 0
        return True

    def _has_more(self, path: Path) -> bool:
        """Whether lines came between the last look and the next segment's beginning."""
        try:
            with path.open("rb") as file:
                file.seek(self._offset)
                return b"\n" in file.read()
        except FileNotFoundError:
            return False

    def _segments(self) -> list[Path]:
        return list_segments(self._folder, EVENTS)


def _in_brief(lines: list[bytes]) -> list[bytes]:
    """The lines with empty tables of worst cells, the last of each kind as it is."""
    whole = {
        next((k for k in range(len(lines) - 1, -1, -1) if kind in lines[k][:_HEAD]), -1)
        for kind in (b'"moved"', b'"committed"')
    }
    return [line if k in whole else _WORST.sub(b'"worst":[]', line) for k, line in enumerate(lines)]


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0  # the oldest is removed at any time


def _line_before_end(path: Path, most: int) -> int:
    """Where a line begins, so many bytes at most before the file's end."""
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


def events_naming(session_folder: Path, step: int) -> Iterator[dict[str, Any]]:
    """The events whose step this is, oldest first: found in the bytes, for to parse a long history takes a minute."""
    wanted = re.compile(rb'^.*"step": ?%d[,}].*$' % step, re.MULTILINE)
    for path in list_segments(session_folder / FOLDER, EVENTS):
        with suppress(FileNotFoundError):
            found = (parse_line(line.group()) for line in wanted.finditer(path.read_bytes()))
            yield from (event for event in found if event is not None and event.get("step") == step)


def last_event(session_folder: Path, kinds: Container[str] | None = None) -> dict[str, Any] | None:
    """The latest event that is whole, of certain kinds if they are given; None without any."""
    for path in reversed(list_segments(session_folder / FOLDER, EVENTS)):
        with suppress(FileNotFoundError), path.open("rb") as file:
            for line in lines_backwards(file):
                event = parse_line(line)
                if event is not None and (kinds is None or event["event"] in kinds):
                    return event
    return None
