"""What all tests share."""

from __future__ import annotations

import logging
import signal
from collections.abc import Iterator

import pytest
import structlog


@pytest.fixture(autouse=True)
def broken_pipes_are_errors() -> Iterator[None]:
    """Gmsh lets the process end at a broken pipe from its start on; the next test expects Python's way, an error."""
    yield
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)


@pytest.fixture(autouse=True)
def logs_of_their_own() -> Iterator[None]:
    """A test that set logging up leaves loggers behind that write to its captured, by then closed, standard error."""
    before = list(logging.getLogger().handlers)
    yield
    structlog.reset_defaults()
    structlog.contextvars.clear_contextvars()
    root = logging.getLogger()
    for handler in [handler for handler in root.handlers if handler not in before]:
        root.removeHandler(handler)
