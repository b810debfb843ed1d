"""A case: one sentence of SPEC.md, and a function that tests it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

__all__ = ["Case", "Outcome", "Skip", "Suite", "Unmet", "section_order"]


class Unmet(Exception):
    """The demand is not met.

    Parameters
    ----------
    expected, got : str
    sent : str
        The request that showed it, readable.
    """

    def __init__(self, expected: str, got: str, sent: str = "") -> None:
        super().__init__(f"expected {expected}, got {got}")
        self.expected, self.got, self.sent = expected, got, sent


class Skip(Exception):
    """The case cannot be tested with this server or client; the text is the reason."""


@dataclass(frozen=True)
class Case:
    """One case.

    Attributes
    ----------
    section : str
        The number of SPEC.md's section or sentence, as ``"10.2"``.
    name : str
        Short, unique with the section.
    demand : str
        The demand of SPEC.md, in one line.
    run : callable
        Gets the stage; raises :class:`Unmet` or :class:`Skip`.
    """

    section: str
    name: str
    demand: str
    run: Callable[[Any], None]

    @property
    def id(self) -> str:
        """Section and name."""
        return f"{self.section}-{self.name}"


@dataclass(frozen=True)
class Outcome:
    """What came of a case: ``verdict`` PASS, FAIL or SKIP."""

    case: Case
    verdict: str
    seconds: float
    expected: str = ""
    got: str = ""
    sent: str = ""


def section_order(section: str) -> tuple[int, ...]:
    """Sections in the order of the document."""
    return tuple(int(part) if part.isdigit() else 0 for part in section.split("."))


class Suite:
    """Cases in the order in which they are written; used as a decorator, ``@suite("10.1")``.

    The function's name is the case's name, its docstring the demand.
    """

    def __init__(self) -> None:
        self._sources: list[Callable[[], Iterable[Case]]] = []

    def __call__(self, section: str) -> Callable[[Callable[[Any], None]], Callable[[Any], None]]:
        """One case."""

        def register(run: Callable[[Any], None]) -> Callable[[Any], None]:
            case = Case(section, run.__name__.strip("_").replace("_", "-"), " ".join((run.__doc__ or "").split()), run)
            self._sources.append(lambda: [case])
            return run

        return register

    def family(self, make: Callable[[], Iterable[Case]]) -> Callable[[], Iterable[Case]]:
        """Many cases of one kind, made from a table."""
        self._sources.append(make)
        return make

    def __iter__(self) -> Iterator[Case]:
        for source in self._sources:
            yield from source()
