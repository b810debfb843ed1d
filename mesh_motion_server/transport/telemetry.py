"""Structured logs to standard error: one line an event, never a payload, a token or a coordinate.

How often, how long, and what of an exception: :mod:`.log_bounds`; where no line is taken: :mod:`.log_stream`.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import MutableMapping
from typing import Any, TextIO, cast

import structlog

from mesh_motion_server.transport.log_bounds import Throttle, places_of_exception, shorten
from mesh_motion_server.transport.log_stream import Unfailing

__all__ = ["configure", "log", "name_session", "tell_suppressed"]

_THROTTLE = Throttle()


def configure(role: str, level: str = "info") -> None:
    """Set logging up once per process: JSON lines, or coloured text on a terminal."""
    renderer: Any = structlog.processors.JSONRenderer()
    if sys.stderr.isatty():
        # values as literals: what a client calls itself must not steer the terminal
        renderer = structlog.dev.ConsoleRenderer(repr_native_str=True)
    shared: list[Any] = [
        structlog.contextvars.merge_contextvars,
        structlog.processors.add_log_level,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        places_of_exception,
        shorten,
    ]
    structlog.configure(
        processors=[_THROTTLE, *shared, renderer],
        wrapper_class=structlog.make_filtering_bound_logger(logging.getLevelNamesMapping()[level.upper()]),
        logger_factory=structlog.PrintLoggerFactory(cast("TextIO", Unfailing(sys.stderr))),
        cache_logger_on_first_use=True,
    )
    structlog.contextvars.bind_contextvars(role=role)
    handler = logging.StreamHandler(Unfailing(sys.stderr))
    handler.setFormatter(structlog.stdlib.ProcessorFormatter(processors=[_clean, renderer], foreign_pre_chain=shared))
    handler.addFilter(_seldom)
    logging.basicConfig(handlers=[handler], level=level.upper())
    logging.captureWarnings(True)
    sys.excepthook = _log_uncaught


def name_session(session: str) -> None:
    """From now on this process' lines say which session they are about."""
    structlog.contextvars.bind_contextvars(session=session)


def tell_suppressed() -> None:
    """A line for each event whose lines were left out since the last time; called every few seconds."""
    for event, count in _THROTTLE.take().items():
        log().warning("suppressed", lines=count, of=event)


def _log_uncaught(_kind: type[BaseException], error: BaseException, _trace: object) -> None:
    """The end of a process is a line as any other."""
    log().error("uncaught", exc_info=error)


def _seldom(record: logging.LogRecord) -> bool:
    return record.levelno <= logging.DEBUG or _THROTTLE.admits(str(record.msg))


def _clean(_logger: Any, _name: str, event: MutableMapping[str, Any]) -> MutableMapping[str, Any]:
    """Lines of the layers below, which log through the standard library, look like ours."""
    structlog.stdlib.ProcessorFormatter.remove_processors_meta(None, "", event)
    return event


def log() -> Any:
    """The logger of this process."""
    return structlog.get_logger()
