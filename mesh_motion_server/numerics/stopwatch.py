"""Wall time of the phases of a motion."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["PHASES", "Stopwatch"]

#: In the order they begin.
PHASES = ("solve", "displace", "predict", "correct")


class Stopwatch:
    """Adds up the seconds spent in each named phase."""

    def __init__(self) -> None:
        self._started = time.perf_counter()
        self._seconds = dict.fromkeys(PHASES, 0.0)

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Count the block's time towards ``name``, one of :data:`PHASES`."""
        begin = time.perf_counter()
        try:
            yield
        finally:
            self._seconds[name] += time.perf_counter() - begin

    def seconds(self) -> dict[str, float]:
        """Seconds of each phase, and of everything since the start as ``total``."""
        return {**self._seconds, "total": time.perf_counter() - self._started}
