"""A check: one promise of the server, with a seed and a count, and what came of it."""

from collections.abc import Callable
from dataclasses import dataclass
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


@dataclass(frozen=True)
class Budget:
    """How much a check does.

    ``count``: how many, of the check's own unit; ``report``: called with the number of those that are done.
    """

    count: int
    report: Callable[[int], None] = lambda _: None

    def admits(self, done: int) -> bool:
        """Whether there is to be another one after so many."""
        self.report(done)
        return done < self.count

    def warms_up(self, done: int, least: int) -> bool:
        """Whether there is to be another one that comes first and is not counted: a tenth, and at least so many."""
        return done < max(least, self.count / 10)


@dataclass(frozen=True)
class Check:
    """One row of the table.

    ``target``: what is promised; ``{count}`` in it is how many of what; ``short``, ``full``: the counts of the two
    plans; ``seconds``: what the short plan takes on two cores; ``run``: (seed, budget) → :class:`Result`. The same seed
    and count do the same. It may raise: that is a failure.
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

    def limit(self, count: int) -> float:
        """Seconds after which a run with this count hangs: it fails."""
        return _AT_LEAST + _SLACK * self.seconds * count / self.short

    def target_of(self, count: int) -> str:
        return self.target.format(count=f"{count:,}".replace(",", " "))
