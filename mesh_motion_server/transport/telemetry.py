"""Structured logs to standard error: one line an event, never a payload, a token or a coordinate."""

from __future__ import annotations

import logging
import sys
from collections.abc import MutableMapping
from typing import Any

import structlog

__all__ = ["configure", "log"]


def configure(role: str, level: str = "info") -> None:
    """Set logging up once per process: JSON lines, or coloured text on a terminal."""
    renderer: Any = structlog.dev.ConsoleRenderer() if sys.stderr.isatty() else structlog.processors.JSONRenderer()
    shared: list[Any] = [
        structlog.contextvars.merge_contextvars,
        structlog.processors.add_log_level,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        structlog.processors.format_exc_info,
    ]
    structlog.configure(
        processors=[*shared, renderer],
        wrapper_class=structlog.make_filtering_bound_logger(logging.getLevelNamesMapping()[level.upper()]),
        logger_factory=structlog.PrintLoggerFactory(sys.stderr),
        cache_logger_on_first_use=True,
    )
    structlog.contextvars.bind_contextvars(role=role)
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(structlog.stdlib.ProcessorFormatter(processors=[_clean, renderer], foreign_pre_chain=shared))
    logging.basicConfig(handlers=[handler], level=level.upper())


def _clean(_logger: Any, _name: str, event: MutableMapping[str, Any]) -> MutableMapping[str, Any]:
    """Lines of the layers below, which log through the standard library, look like ours."""
    structlog.stdlib.ProcessorFormatter.remove_processors_meta(None, "", event)
    return event


def log() -> Any:
    """The logger of this process."""
    return structlog.get_logger()
