"""The events of a history: one JSON object a line, ``at`` (Unix time, seconds) and ``event`` first.

===============  ====================================================================================================
event            content, in addition to ``at`` and ``event``
===============  ====================================================================================================
``built``        nodes, cells {type: count}, patches {name: {role, nodes}}, moving_nodes, box, warnings, settings,
                 quality (as BUILT's), seconds_total, version, maker
``moved``        step, iteration, quality, correction, caches, seconds, warnings (as MOVED's), seconds_total,
                 enrichment_points (rows of coordinates)
``committed``    step, quality (as COMMITTED's), digest (hexadecimal), seconds_total; final_step if COMMIT named it
``rolled_back``  step, iteration: the trial that was dropped, iteration 0 without one
``refused``      request, step, code, message, hint, details
``resumed``      step, epoch, version, maker
``suspended``    step
``closed``       step
``joined``       step: a client has joined again after ``suspended``
``frozen``       step, message: the disk failed
``failed``       step, message
===============  ====================================================================================================

``recovered`` is true in a line that was written when the session was resumed, from the journal's content. ``kept``
is true in the ``built`` line that stays when its segment is removed, alone in a segment of the same name: the lines
that followed it are gone, and the next line may be of any step. ``untold`` is the number of refusals before it that
were not written. ``boundary_ended`` (step, message) says that the boundary log has stopped. Readers ignore lines that
are not JSON (a crash leaves the last one incomplete) and unknown events. A number that is not finite is null.
"""

import json
import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from mesh_motion_server.session.history.segments import list_segments

FOLDER = "history"
EVENTS = "events"

_KNOWN = (b',"event":"committed",', b',"event":"resumed",')
_BUILT = b',"event":"built",'
#: The time and event name at the start of a line take fewer bytes than this.
_HEAD = 80
#: Bytes read at a time from the end of a segment; a line takes some kilobytes.
_BLOCK = 64 << 10
_ENCODER = json.JSONEncoder(allow_nan=False, separators=(",", ":"), ensure_ascii=False, default=str)


def line_of(at: float, event: str, values: Mapping[str, Any]) -> bytes:
    """An event as a line."""
    content = {"at": at, "event": event, **values}
    try:
        text = _encoded(content)
    except ValueError:
        text = _encoded(finite(content))
    return text.encode("utf-8", "backslashreplace") + b"\n"


def parse_line(line: bytes) -> dict[str, Any] | None:
    """The event of a line; None if the line is incomplete."""
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) and isinstance(found.get("event"), str) else None


def read_events(session_folder: Path) -> Iterator[dict[str, Any]]:
    """All events in a session's folder, oldest first."""
    for path in list_segments(session_folder / FOLDER, EVENTS):
        try:
            file = path.open("rb")
        except FileNotFoundError:
            continue  # the oldest segment was removed in the meantime
        with file:
            yield from (event for line in file if (event := parse_line(line)) is not None)


def last_committed(session_folder: Path) -> tuple[bool, int]:
    """Whether there are any events, and the step of the latest ``committed`` or ``resumed``; 0 if there is none."""
    paths = list_segments(session_folder / FOLDER, EVENTS)
    for path in reversed(paths):
        with path.open("rb") as file:
            for line in lines_backwards(file):
                if any(known in line for known in _KNOWN) and (event := parse_line(line)) is not None:
                    return True, int(event["step"])
    return any(path.stat().st_size for path in paths), 0


def lines_backwards(file: BinaryIO) -> Iterator[bytes]:
    """Yield the lines of a file, the last one first; an end without a newline, as after a crash, is ignored."""
    place = file.seek(0, os.SEEK_END)
    pieces: list[bytes] = []  # the pieces of a line whose beginning is not read yet, the last piece first
    is_whole = False
    while place:
        size = min(_BLOCK, place)
        place -= size
        file.seek(place)
        first, *others = file.read(size).split(b"\n")
        if others:
            pieces.append(others.pop())
            if is_whole:
                yield b"".join(reversed(pieces))
            yield from reversed(others)
            pieces, is_whole = [], True
        pieces.append(first)
    if is_whole:
        yield b"".join(reversed(pieces))


def kept_of(path: Path) -> bytes:
    """The content to keep of a removed segment: the ``built`` line, marked; empty if it has none."""
    with path.open("rb") as file:
        for line in file:
            if _BUILT in line[:_HEAD] and (event := parse_line(line)) is not None:
                at, name = event.pop("at"), event.pop("event")
                return line_of(at, name, event | {"kept": True})
    return b""


def end_torn_line(handle: int) -> None:
    """End an incomplete last line, so that the next event starts on a new line."""
    size = os.fstat(handle).st_size
    if size and os.pread(handle, 1, size - 1) != b"\n":
        os.write(handle, b"\n")


def _encoded(content: dict[str, Any]) -> str:
    """Encode as JSON; when the corrected quality is the standard one, which is most of a line, encode it only once."""
    quality = content.get("quality", {})
    summary = quality.get("standard")
    if summary is None or quality.get("corrected") is not summary:
        return _ENCODER.encode(content)
    names = ("standard", "corrected")
    text, once = _ENCODER.encode(content | {"quality": quality | dict.fromkeys(names, 0)}), _ENCODER.encode(summary)
    for name in names:  # the first match is the key, because quotes in a string would be escaped
        text = text.replace(f'"{name}":0', f'"{name}":{once}', 1)
    return text


def finite(value: Any) -> Any:
    """Replace every number that JSON cannot represent by None."""
    if isinstance(value, Mapping):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
