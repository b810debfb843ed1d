"""What all tests share."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True)
def broken_pipes_are_errors() -> Iterator[None]:
    """Gmsh lets the process end at a broken pipe from its start on; the next test expects Python's way, an error."""
    yield
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)
