"""A case: one sentence of SPEC.md, and a function that tests it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

__all__ = ["Case", "Outcome", "Rows", "Skip", "Suite", "Unmet", "require", "section_order"]


Run = Callable[..., None]
#: Cases of one kind: the name of each, and the values in which it differs from the others.
Rows = Mapping[str, Sequence[Any]]
Make = Callable[[], Iterable[tuple[Any, ...]]]


class Unmet(Exception):
    """The demand is not met.

    Parameters
    ----------
    sent : str
        The request that showed it, readable.
    """

    def __init__(self, expected: str, got: str, sent: str = "") -> None:
        super().__init__(f"expected {expected}, got {got}")
        self.expected, self.got, self.sent = expected, got, sent


def require(condition: object, expected: str, got: str) -> None:
    """Raise :class:`Unmet` unless the condition holds."""
    if not condition:
        raise Unmet(expected, got)


class Skip(Exception):
    """The case cannot be tested with this server or client; the text is the reason."""


@dataclass(frozen=True)
class Case:
    """One case."""

    section: str  # the number of SPEC.md's section or sentence, as ``"10.2"``
    name: str  # short, unique with the section
    demand: str  # the demand of SPEC.md, in one line
    run: Callable[[Any], None]  # gets the stage; raises :class:`Unmet` or :class:`Skip`

    @property
    def id(self) -> str:
        """Section and name."""
        return f"{self.section}-{self.name}"


@dataclass(frozen=True)
class Outcome:
    """The result of a case: ``verdict`` PASS, FAIL or SKIP."""

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
    """Cases in the order in which they are written; a decorator, ``@suite("10.1")`` or ``@suite("10.1", rows)``.

    The function's name is the case's name, its docstring the demand. With rows there is a case for each row: its key is
    the name, and its values are the function's further arguments; ``{0}`` in the docstring is the first value. Rows may
    be a function that returns them, where they are read from SPEC.md's tables.
    """

    def __init__(self) -> None:
        self._sources: list[Callable[[], Iterable[Case]]] = []

    def __call__(self, section: str, rows: Rows | Callable[[], Rows] | None = None) -> Callable[[Run], Run]:
        """One case, or one for each row."""

        def register(run: Run) -> Run:
            demand = " ".join((run.__doc__ or "").split())

            def cases() -> Iterator[Case]:
                if rows is None:
                    yield Case(section, run.__name__.strip("_").replace("_", "-"), demand, run)
                    return
                for name, values in (rows() if callable(rows) else rows).items():
                    yield Case(section, name, demand.format(*values), partial(_called, run, values))

            self._sources.append(cases)
            return run

        return register

    def family(self, run: Run, section: str = "") -> Callable[[Make], Make]:
        """Cases of one kind: a generator yields section (unless it is given), name, demand and further arguments."""

        def register(make: Make) -> Make:
            def cases() -> Iterator[Case]:
                for row in make():
                    at, name, demand, *values = (section, *row) if section else row
                    yield Case(at, name, demand, partial(_called, run, values))

            self._sources.append(cases)
            return make

        return register

    def __iter__(self) -> Iterator[Case]:
        for source in self._sources:
            yield from source()


def _called(run: Run, values: Sequence[Any], stage: Any) -> None:
    run(stage, *values)
