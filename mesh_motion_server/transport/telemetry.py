"""Structured logs to standard error: one line per event, never a payload, a token or a coordinate.

Limits of frequency, length and exceptions: :mod:`.log_bounds`; streams that accept no line: :mod:`.log_stream`.
"""

import json
import logging
import sys
from datetime import UTC, datetime
from typing import Any

from mesh_motion_server.transport.log_bounds import Throttle, places_of_exception, shortened
from mesh_motion_server.transport.log_stream import Unfailing
from mesh_motion_server.transport.processes import name_process

__all__ = ["configure", "log", "log_suppressed", "name_session"]

_THROTTLE = Throttle()
_LOGGER = logging.getLogger("mesh_motion_server.transport")
#: Values in every line of this process.
_NAMES: dict[str, str] = {}


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
