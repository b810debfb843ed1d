"""Runs cases, one after the other; an error in one case is the outcome of this case only."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Protocol

from mesh_motion_conformance.case import Case, Outcome, Skip, Unmet
from mesh_motion_conformance.line import Ended, Silence
from mesh_motion_conformance.wire import Malformed

__all__ = ["Stage", "run", "selected"]


class Stage(Protocol):
    """The server and the options that cases run with."""

    @property
    def sent(self) -> str:
        """The last request, readable."""

    def between(self) -> None:
        """Called after each passed case: raises if the case left something, such as a second reply."""

    def mend(self) -> None:
        """Called after each failed case: remove everything that could disturb the next case."""


#: After this number of cases in a row without any reply the run ends: the server has ended.
_SILENT = 10


def selected(cases: Iterable[Case], only: Sequence[str]) -> list[Case]:
    """Cases selected by id, by section or by the beginning of a section; all cases without a selection."""
    if not only:
        return list(cases)
    return [case for case in cases if any(_names(name, case) for name in only)]


def _names(name: str, case: Case) -> bool:
    """``10`` selects 10, 10.2 and all their cases, ``10.2-repeat`` the cases that begin with it."""
    begins = case.section.startswith(f"{name}.") or ("-" in name and case.id.startswith(name))
    return begins or name in (case.section, case.id)


def run(cases: Iterable[Case], stage: Stage, report: Callable[[Outcome], None] | None = None) -> list[Outcome]:
    """Outcomes of all cases; ``report`` is called with each outcome immediately."""
    outcomes = []
    for outcome in _outcomes(cases, stage):
        outcomes.append(outcome)
        if report is not None:
            report(outcome)
    return outcomes


def _outcomes(cases: Iterable[Case], stage: Stage) -> Iterator[Outcome]:
    silent = 0
    for case in cases:
        if silent >= _SILENT:
            yield Outcome(case, "SKIP", 0.0, got=f"no reply in {silent} cases in a row: no server is there")
            continue
        started = time.perf_counter()
        verdict, lines, is_silent = _verdict(case, stage)
        silent = silent + 1 if is_silent else 0 if verdict != "SKIP" else silent
        yield Outcome(case, verdict, time.perf_counter() - started, **lines)


def _verdict(case: Case, stage: Stage) -> tuple[str, dict[str, str], bool]:
    """PASS, FAIL or SKIP; the lines of the report; True if no reply came."""
    try:
        case.run(stage)
        stage.between()
    except Skip as reason:
        return "SKIP", {"got": str(reason)}, False
    except Exception as error:
        lines = _failure(case, error) | {"sent": getattr(error, "sent", "") or stage.sent}
        stage.mend()
        return "FAIL", lines, isinstance(error, Silence)
    return "PASS", {}, False


def _failure(case: Case, error: Exception) -> dict[str, str]:
    """Return the expected and the received reply; a wrong reply may cause an error in the case itself."""
    if isinstance(error, Unmet):
        return {"expected": error.expected, "got": error.got}
    if isinstance(error, (Silence, Ended, Malformed)):
        return {"expected": case.demand, "got": str(error)}
    return {"expected": case.demand, "got": f"a reply that the case could not read: {type(error).__name__}: {error}"}
