"""Structured logs to standard error: one line per event, never a payload, a token or a coordinate.

A client that sends a hundred thousand wrong messages gets as many answers but not as many lines: for each event a burst
is written, then a few lines a second, and one line gives the number of omitted ones. Debug lines have no limit; they
are for short investigations.
"""

from __future__ import annotations

import json
import logging
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from types import TracebackType
from typing import Any

from mesh_motion_server.transport.log_stream import Unfailing
from mesh_motion_server.transport.processes import name_process

#: Lines of one event in a burst, and then per second.
_BURST = 100.0
_RATE = 1.0
#: Largest number of characters of a value.
_LONGEST = 300
#: Largest number of distinct events; events are words of the program, of which there are some dozens.
_EVENTS = 500
#: The texts of these exceptions name modules and files only.
_OF_THE_SYSTEM = (ImportError, OSError)
_LOGGER = logging.getLogger("mesh_motion_server.transport")
#: Values in every line of this process.
_NAMES: dict[str, str] = {}


class Throttle:
    """A token bucket for the lines of each event.

    Parameters
    ----------
    clock : callable
        Monotonic seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._buckets: dict[str, tuple[float, float]] = {}
        self.suppressed: Counter[str] = Counter()

    def admits(self, event: str) -> bool:
        """Return whether a line of this event may be written now; count it if not."""
        now = self._clock()
        if event not in self._buckets and len(self._buckets) >= _EVENTS:
            event = "others"
        filled, when = self._buckets.get(event, (_BURST, now))
        filled = min(_BURST, filled + _RATE * (now - when))
        admitted = filled >= 1.0
        self._buckets[event] = (filled - admitted, now)
        self.suppressed[event] += not admitted
        return admitted

    def take(self) -> dict[str, int]:
        """Return how many lines were omitted since the last call, by event."""
        taken = {event: count for event, count in self.suppressed.items() if count}
        self.suppressed.clear()
        return taken


_THROTTLE = Throttle()


class _Log:
    """The logger of this process: an event is one word, with named values."""

    def debug(self, event: str, **values: Any) -> None:
        """Log details for short investigations."""
        self._say(logging.DEBUG, event, values)

    def info(self, event: str, **values: Any) -> None:
        """Log a normal event."""
        self._say(logging.INFO, event, values)

    def warning(self, event: str, **values: Any) -> None:
        """Log what the operator may want to change."""
        self._say(logging.WARNING, event, values)

    def error(self, event: str, **values: Any) -> None:
        """Log a failure."""
        self._say(logging.ERROR, event, values)

    def exception(self, event: str, **values: Any) -> None:
        """Log a failure with the exception that is being handled."""
        self._say(logging.ERROR, event, values, raised=sys.exception())

    def _say(self, level: int, event: str, values: dict[str, Any], raised: BaseException | None = None) -> None:
        _LOGGER.log(level, event, exc_info=raised, extra={"values": values})


_LOG = _Log()


class _Line(logging.Formatter):
    """Format as JSON, or as text for a terminal; lines of other layers and of libraries look the same."""

    def __init__(self, *, json_lines: bool) -> None:
        super().__init__()
        self._json = json_lines

    def format(self, record: logging.LogRecord) -> str:
        raised = places_of_exception(record.exc_info[1]) if record.exc_info else {}
        values = _NAMES | getattr(record, "values", {}) | raised
        at, event = datetime.fromtimestamp(record.created, UTC).isoformat().replace("+00:00", "Z"), record.getMessage()
        line = shortened(values | {"event": event, "level": record.levelname.lower(), "timestamp": at})
        if self._json:
            return json.dumps(line, default=repr)
        # values as literals: client text must not control the terminal
        pairs = " ".join(f"{name}={line[name]!r}" for name in values)
        return f"{at} {line['level']:7} {line['event']} {pairs}"


def configure(role: str, level: str = "info") -> None:
    """Name the process and configure its log: JSON lines, or text on a terminal."""
    name_process(role)
    _NAMES["role"] = role
    _THROTTLE.take()  # the parent process reports the lines that it omitted itself
    handler = logging.StreamHandler(Unfailing(sys.stderr))
    handler.setFormatter(_Line(json_lines=not sys.stderr.isatty()))
    handler.addFilter(_seldom)
    logging.basicConfig(handlers=[handler], level=level.upper(), force=True)
    logging.captureWarnings(True)
    sys.excepthook = _log_uncaught


def name_session(session: str) -> None:
    """Add the session to all further lines of this process."""
    _NAMES["session"] = session


def log_suppressed() -> None:
    """Log the number of omitted lines for each event since the last call; called every few seconds."""
    for event, count in _THROTTLE.take().items():
        _LOG.warning("suppressed", lines=count, of=event)


def _log_uncaught(_kind: type[BaseException], error: BaseException, _trace: object) -> None:
    """Log an uncaught exception as a normal line."""
    _LOGGER.error("uncaught", exc_info=error)


def _seldom(record: logging.LogRecord) -> bool:
    return record.levelno <= logging.DEBUG or _THROTTLE.admits(str(record.msg))


def log() -> _Log:
    """Return the logger of this process."""
    return _LOG


def shortened(values: Mapping[str, Any]) -> dict[str, Any]:
    """Shorten each value to the length limit, because clients choose some of them."""
    return {
        key: f"{value[:_LONGEST]}… ({len(value)} characters)"
        if isinstance(value, str) and len(value) > _LONGEST
        else value
        for key, value in values.items()
    }


def places_of_exception(raised: BaseException | None) -> dict[str, Any]:
    """Return type and places of an exception; its text may quote a client's data, which only that client may see."""
    if raised is None:
        return {}
    fields = {"exception": type(raised).__name__, "trace": _places(raised.__traceback__)}
    return fields | {"reason": str(raised)} if isinstance(raised, _OF_THE_SYSTEM) else fields


def _places(trace: TracebackType | None) -> list[str]:
    """Return file, line and function of each frame, outermost first."""
    frames = traceback.extract_tb(trace)
    return [f"{frame.filename}:{frame.lineno} {frame.name}" for frame in frames[-20:]]
