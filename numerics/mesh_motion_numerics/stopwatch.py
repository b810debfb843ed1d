"""Wall time of the phases of a motion, and the time limit that a caller sets."""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field

from mesh_motion_protocol.errors import Timeout

#: The phases, in the order in which they begin.
PHASES = ("solve", "displace", "predict", "correct")


@dataclass
class Stopwatch:
    """Adds up the seconds spent in each named phase."""

    _started: float = field(default_factory=time.perf_counter)
    _seconds: dict[str, float] = field(default_factory=dict.fromkeys(PHASES, 0.0).copy)

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Add the block's time to the phase ``name``, one of :data:`PHASES`."""
        begin = time.perf_counter()
        try:
            yield
        finally:
            self._seconds[name] += time.perf_counter() - begin

    def seconds(self) -> dict[str, float]:
        """Seconds of each phase, and all seconds since the start as ``total``."""
        return {**self._seconds, "total": time.perf_counter() - self._started}


#: End of the caller's limit on :func:`time.monotonic`'s clock, and the limit itself.
_END: ContextVar[tuple[float, float]] = ContextVar("_END", default=(math.inf, math.inf))


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Let :func:`check_time` raise within the block after ``seconds`` are over."""
    token = _END.set((time.monotonic() + seconds, seconds))
    try:
        yield
    finally:
        _END.reset(token)


def check_time() -> None:
    """Raise if the time is over; called between the parts of a long computation, which has changed nothing yet.

    Raises Timeout if the caller's time limit is over.
    """
    end, seconds = _END.get()
    if time.monotonic() > end:
        raise Timeout(
            f"the motion was not computed within the {seconds:g} s that the request allows",
            hint="allow more time, or take a smaller step",
        )
