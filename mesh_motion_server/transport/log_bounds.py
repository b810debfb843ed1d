"""Bounds on what is logged: how often an event, how long a value, and of an exception the places only.

Who sends a hundred thousand wrong messages gets as many answers but not as many lines: of each event a burst is
written, then a few a second, and one line says how many were left out. Debug lines are not bounded; they are for a
look at a server, not for its life.
"""

from __future__ import annotations

import time
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Any

__all__ = ["Throttle", "places_of_exception", "shortened"]

#: Lines of one event at once, and then a second.
_BURST = 100.0
_RATE = 1.0
#: Characters of a value.
_LONGEST = 300
#: Distinct events told apart; they are words of the program, so there are some dozens.
_EVENTS = 500
#: Their texts name modules and files.
_OF_THE_SYSTEM = (ImportError, OSError)


class Throttle:
    """A bucket of lines for each event.

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
        """Whether a line of this event may be written now; one that may not is counted."""
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
        """How many lines were left out since the last time, by event."""
        taken = {event: count for event, count in self.suppressed.items() if count}
        self.suppressed.clear()
        return taken


def shortened(values: Mapping[str, Any]) -> dict[str, Any]:
    """No value is longer than a line should be, whatever a client has called itself."""
    return {
        key: f"{value[:_LONGEST]}… ({len(value)} characters)"
        if isinstance(value, str) and len(value) > _LONGEST
        else value
        for key, value in values.items()
    }


def places_of_exception(raised: BaseException | None) -> dict[str, Any]:
    """Type and places of an exception; its text may quote what a client has sent, and goes to that client alone."""
    if raised is None:
        return {}
    fields = {"exception": type(raised).__name__, "trace": _places(raised.__traceback__)}
    return fields | {"reason": str(raised)} if isinstance(raised, _OF_THE_SYSTEM) else fields


def _places(trace: TracebackType | None) -> list[str]:
    """File, line and function of each frame, outermost first."""
    frames = traceback.extract_tb(trace)
    return [f"{frame.filename}:{frame.lineno} {frame.name}" for frame in frames[-20:]]
