"""A check: one promise of the server, with a seed and a count, and what came of it."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

#: The limit of a row: a factor on its time on two cores, and the least limit in seconds.
_SLACK, _AT_LEAST = 10.0, 600.0


class BrokenPromise(Exception):
    """A check has seen what must never happen; the message says what, and where to look."""


def require(condition: object, message: str) -> None:
    """Raise :class:`BrokenPromise` with this message unless the condition holds."""
    if not condition:
        raise BrokenPromise(message)


@dataclass(frozen=True)
class Result:
    """What a check found.

    ``got``: in one line, to compare with the target; ``details``: every figure that was measured, plain values.
    """

    got: str
    passed: bool
    details: dict[str, Any]


@dataclass
class Budget:
    """How much a check does: a count, or as many as fit in a time.

    ``count``: how many, of the check's own unit; ``seconds`` (float or None): if given, it counts instead; what cannot
    be done by halves is done once all the same; ``report``: called with the number of those that are done.
    """

    count: int
    seconds: float | None = None
    report: Callable[[int], None] = lambda _: None
    _start: float = field(default_factory=time.monotonic)

    def admits(self, done: int) -> bool:
        """Whether there is to be another one after so many."""
        self.report(done)
        if self.seconds is not None:
            return time.monotonic() - self._start < self.seconds
        return done < self.count

    def warms_up(self, done: int, least: int) -> bool:
        """Whether there is to be another one that comes first and is not counted: a tenth, and at least so many."""
        share = done / self.count if self.seconds is None else (time.monotonic() - self._start) / self.seconds
        return done < least or share < 0.1


@dataclass(frozen=True)
class Check:
    """One row of the table.

    ``target``: what is promised; ``{count}`` in it is how many of what; ``short``, ``full``: the counts of the two
    plans; ``seconds``: what the short plan takes on two cores: the check's share when a time is given for all; ``run``:
    (seed, budget) → :class:`Result`. The same seed and count do the same. It may raise: that is a failure.
    """

    name: str
    target: str
    short: int
    full: int
    seconds: float
    run: Callable[[int, Budget], Result]

    def count(self, plan: str) -> int:
        """How many in the plan "short" or "full"."""
        return {"short": self.short, "full": self.full}[plan]

    def limit(self, count: int, seconds: float | None) -> float:
        """Seconds after which a run with this count, or with this time of its own, hangs: it fails."""
        return _AT_LEAST + _SLACK * (self.seconds * count / self.short if seconds is None else seconds)

    def target_of(self, count: int | None) -> str:
        """The target with its count; None: with n, for as many as fit in a time."""
        return self.target.format(count="n" if count is None else f"{count:,}".replace(",", " "))
