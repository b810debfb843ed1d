"""The command: it chooses the cases and the subject, runs them, and prints the report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from mesh_motion_conformance.case import Case, Outcome
from mesh_motion_conformance.client import Client, ClientStage, client_cases
from mesh_motion_conformance.presence import require_somebody
from mesh_motion_conformance.report import line_of, summary, write_json, write_junit
from mesh_motion_conformance.runner import run, selected
from mesh_motion_conformance.server import Stage, server_cases

__all__ = ["Subject", "conform", "listed"]


@dataclass(frozen=True)
class Subject:
    """The tested program: a server's endpoint, or a client."""

    endpoint: str = ""  # empty for a client
    client: str | Client = ""  # the command of its driver program, or a client in this process; empty for a server
    #: seconds, opening_seconds: the longest wait for a reply, and for a reply to a request that starts a process or
    #: computes
    seconds: float = 10.0
    patience: float = 5.0  # cases with longer time-outs of the server are skipped
    opening_seconds: float = 120.0

    def cases(self) -> list[Case]:
        """The cases for this kind of subject."""
        return client_cases() if self.client else server_cases()

    def stage(self) -> Stage | ClientStage:
        """The stage on which they are played."""
        if self.client:
            return ClientStage(self.client)
        waits = {"seconds": self.seconds, "opening_seconds": self.opening_seconds, "patience": self.patience}
        return Stage(self.endpoint, **waits)


def listed(subject: Subject, only: Sequence[str] = ()) -> str:
    """The cases, one a line."""
    return "\n".join(f"{case.id}: {case.demand}" for case in selected(subject.cases(), only))


def conform(
    subject: Subject,
    report: Callable[[str], None],
    *,
    only: Sequence[str] = (),
    json: Path | None = None,
    junit: Path | None = None,
    quiet: bool = False,
) -> list[Outcome]:
    """Run the cases with the subject.

    Raises Unreachable if no server answers at the endpoint.

    Parameters
    ----------
    report : callable
        Takes each line of the report.
    only : sequence of str
        Sections or beginnings of ids; empty: all.
    json, junit : Path, optional
        File for a report.
    quiet : bool
        Print failures and the summary only.
    """

    def show(outcome: Outcome) -> None:
        if outcome.verdict == "FAIL" or not quiet:
            report(line_of(outcome))

    if subject.endpoint:
        require_somebody(subject.endpoint, subject.seconds)
    stage = subject.stage()
    try:
        outcomes = run(selected(subject.cases(), only), stage, show)
    finally:
        stage.close()
    report(summary(outcomes))
    if json is not None:
        write_json(json, outcomes, str(subject.client or subject.endpoint))
    if junit is not None:
        write_junit(junit, outcomes)
    return outcomes
