"""Structured logs to standard error: one line an event, never a payload, a token or a coordinate.

How often, how long, and what of an exception: :mod:`.log_bounds`; where no line is taken: :mod:`.log_stream`.
"""

from __future__ import annotations

import json
import logging
import sys
from datetime import UTC, datetime
from typing import Any

from mesh_motion_server.transport.log_bounds import Throttle, places_of_exception, shortened
from mesh_motion_server.transport.log_stream import Unfailing
from mesh_motion_server.transport.processes import name_process

__all__ = ["configure", "log", "name_session", "tell_suppressed"]

_THROTTLE = Throttle()
_LOGGER = logging.getLogger("mesh_motion_server.transport")
#: What every line of this process says.
_NAMES: dict[str, str] = {}


class _Log:
    """The logger of this process: an event is a word, and what it is about are named values."""

    def debug(self, event: str, **values: Any) -> None:
        """For a look at a server, not for its life."""
        self._say(logging.DEBUG, event, values)

    def info(self, event: str, **values: Any) -> None:
        """What happens as it should."""
        self._say(logging.INFO, event, values)

    def warning(self, event: str, **values: Any) -> None:
        """What the operator may want to change."""
        self._say(logging.WARNING, event, values)

    def error(self, event: str, **values: Any) -> None:
        """What went wrong."""
        self._say(logging.ERROR, event, values)

    def exception(self, event: str, **values: Any) -> None:
        """What went wrong, with the exception that is being handled."""
        self._say(logging.ERROR, event, values, raised=sys.exception())

    def _say(self, level: int, event: str, values: dict[str, Any], raised: BaseException | None = None) -> None:
        _LOGGER.log(level, event, exc_info=raised, extra={"values": values})


_LOG = _Log()


class _Line(logging.Formatter):
    """JSON, or text for a terminal; lines of the layers below, and of libraries, look like ours."""

    def __init__(self, *, json_lines: bool) -> None:
        super().__init__()
        self._json = json_lines

    def format(self, record: logging.LogRecord) -> str:
        """See :class:`logging.Formatter`."""
        raised = places_of_exception(record.exc_info[1]) if record.exc_info else {}
        values = _NAMES | getattr(record, "values", {}) | raised
        at, event = datetime.fromtimestamp(record.created, UTC).isoformat().replace("+00:00", "Z"), record.getMessage()
        line = shortened(values | {"event": event, "level": record.levelname.lower(), "timestamp": at})
        if self._json:
            return json.dumps(line, default=repr)
        # values as literals: what a client calls itself must not steer the terminal
        pairs = " ".join(f"{name}={line[name]!r}" for name in values)
        return f"{at} {line['level']:7} {line['event']} {pairs}"


def configure(role: str, level: str = "info") -> None:
    """Name the process and set its logging up: JSON lines, or text on a terminal."""
    name_process(role)
    _NAMES["role"] = role
    _THROTTLE.take()  # what the process left out that this one was forked from is told there
    handler = logging.StreamHandler(Unfailing(sys.stderr))
    handler.setFormatter(_Line(json_lines=not sys.stderr.isatty()))
    handler.addFilter(_seldom)
    logging.basicConfig(handlers=[handler], level=level.upper(), force=True)
    logging.captureWarnings(True)
    sys.excepthook = _log_uncaught


def name_session(session: str) -> None:
    """From now on this process' lines say which session they are about."""
    _NAMES["session"] = session


def tell_suppressed() -> None:
    """A line for each event whose lines were left out since the last time; called every few seconds."""
    for event, count in _THROTTLE.take().items():
        _LOG.warning("suppressed", lines=count, of=event)


def _log_uncaught(_kind: type[BaseException], error: BaseException, _trace: object) -> None:
    """The end of a process is a line as any other."""
    _LOGGER.error("uncaught", exc_info=error)


def _seldom(record: logging.LogRecord) -> bool:
    return record.levelno <= logging.DEBUG or _THROTTLE.admits(str(record.msg))


def log() -> _Log:
    """The logger of this process."""
    return _LOG
