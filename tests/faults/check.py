"""A check: one promise of the server, with a seed and a count, and its result."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

#: The limit of a row: a factor on its time on two cores, and the least limit in seconds.
_SLACK, _AT_LEAST = 10.0, 600.0


class BrokenPromise(Exception):
    """A promise of the server was broken; the message has the evidence and the place."""


def require(condition: object, message: str) -> None:
    """Raise :class:`BrokenPromise` with this message unless the condition holds."""
    if not condition:
        raise BrokenPromise(message)


@dataclass(frozen=True)
class Result:
    """The result of a check.

    ``got``: result in one line, to compare with the target; ``details``: all measured figures, plain values.
    """

    got: str
    passed: bool
    details: dict[str, Any]


@dataclass(frozen=True)
class Budget:
    """How much a check does.

    ``count``: number of units of work; ``report``: called with the number of finished units.
    """

    count: int
    report: Callable[[int], None] = lambda _: None

    def admits(self, done: int) -> bool:
        """Whether another unit follows after this number."""
        self.report(done)
        return done < self.count

    def warms_up(self, done: int, least: int) -> bool:
        """Whether another unit comes first that is not counted: a tenth of the count, and at least this number."""
        return done < max(least, self.count / 10)


@dataclass(frozen=True)
class Check:
    """One row of the table.

    ``target``: the promise; ``{count}`` in it is the number of units; ``short``, ``full``: counts of the two plans;
    ``seconds``: time of the short plan on two cores; ``run``: (seed, budget) → :class:`Result`. The same seed and count
    give the same work. An exception is a failure.
    """

    name: str
    target: str
    short: int
    full: int
    seconds: float
    run: Callable[[int, Budget], Result]

    def count(self, plan: str) -> int:
        """Count in the plan "short" or "full"."""
        return {"short": self.short, "full": self.full}[plan]

    def limit(self, count: int) -> float:
        """Time limit of a run with this count, seconds; after it the check fails."""
        return _AT_LEAST + _SLACK * self.seconds * count / self.short

    def target_of(self, count: int) -> str:
        return self.target.format(count=f"{count:,}".replace(",", " "))
