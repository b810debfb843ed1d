"""Limits of the log: the rate of an event, the length of a value, and only the places of an exception.

A client that sends a hundred thousand wrong messages gets as many answers but not as many lines: for each event a burst
is written, then a few lines a second, and one line gives the number of omitted ones. Debug lines have no limit; they
are for short investigations.
"""

import time
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Any

__all__ = ["Throttle", "places_of_exception", "shortened"]

#: Lines of one event in a burst, and then per second.
_BURST = 100.0
_RATE = 1.0
#: Largest number of characters of a value.
_LONGEST = 300
#: Largest number of distinct events; events are words of the program, of which there are some dozens.
_EVENTS = 500
#: The texts of these exceptions name modules and files only.
_OF_THE_SYSTEM = (ImportError, OSError)


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
