"""The conformance suite for the server that ``mesh-motion serve`` starts, and for each client that is found.

The suite knows SPEC.md alone. A part of the cases is a seeded choice with at least one case of every section and
sentence that has cases; they always come in the order of the document.
"""

import os
import shutil
import tempfile
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from random import Random
from typing import Any

from mesh_motion_client.conformance import play
from mesh_motion_conformance.case import Case, Outcome
from mesh_motion_conformance.client import Client
from mesh_motion_conformance.command import Subject
from mesh_motion_conformance.runner import run as put
from mesh_motion_conformance.server import server_cases

from tests.faults.check import Budget, Check, Result
from tests.faults.server_process import ServerProcess

#: Further clients under test, as ``NAME=COMMAND`` separated by semicolons; a command is what ``mesh-motion conform
#: --client`` takes.
CLIENTS_VARIABLE = "MESH_MOTION_CONFORM_CLIENTS"
#: Driver programs of other languages, tested where one is found on PATH (`make prove` builds them where it can).
_PROGRAMS = {name: f"mesh-motion-conform-{end}" for name, end in (("C", "c"), ("C++", "cpp"), ("Fortran", "fortran"))}
#: Short enough that their end is part of the suite.
_SETTINGS: dict[str, Any] = {"lease_seconds": 1.0, "collective_timeout_seconds": 1.0}
_WAIT_SECONDS = 60.0
#: Cases that cannot be made from outside, or only with gigabytes.
_NOT_TO_BE_HAD = {"8-COMMITTING", "8-FROZEN", "8-FAILED", "6-upload-larger-than-max-session-bytes"}
_SERVER = "server"


def clients() -> dict[str, str | Client]:
    """Name → our client, or the command line of another client's driver program that is found here."""
    found: dict[str, str | Client] = {"Python": play}
    found |= {name: program for name, program in _PROGRAMS.items() if shutil.which(program)}
    for entry in filter(None, os.environ.get(CLIENTS_VARIABLE, "").split(";")):
        name, _, command = entry.partition("=")
        found[name.strip()] = command.strip()
    return found


def choice(cases: Sequence[Case], count: int, random: Random) -> list[Case]:
    """Return this number of cases in their order, with at least one of each section and sentence."""
    shuffled = list(cases)
    random.shuffle(shuffled)
    first = {case.section: case for case in shuffled}
    rest = [case for case in shuffled if case is not first[case.section]]
    wanted = {case.id for case in [*first.values(), *rest][: max(count, len(first))]}
    return [case for case in cases if case.id in wanted]


def verdict(name: str, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    counts = Counter(outcome.verdict for outcome in outcomes)
    allowed = _NOT_TO_BE_HAD if name == _SERVER else set()
    return {
        "cases": len(outcomes),
        "sections": len({outcome.case.section for outcome in outcomes}),
        "passed": counts["PASS"],
        "skipped": sorted(o.case.id for o in outcomes if o.verdict == "SKIP"),
        "failed": [
            {"id": o.case.id, "sent": o.sent, "expected": o.expected, "got": o.got}
            for o in outcomes
            if o.verdict == "FAIL" or (o.verdict == "SKIP" and o.case.id not in allowed)
        ],
    }


def put_to(subject: Subject, cases: Sequence[Case], budget: Budget) -> list[Outcome]:
    """Outcomes of the cases that the budget allows."""
    stage = subject.stage()
    try:
        return put((case for number, case in enumerate(cases) if budget.admits(number)), stage)
    finally:
        stage.close()


def run(seed: int, budget: Budget) -> Result:
    """Run all cases or a part of them for each client; the part is the same share as for the server."""
    random = Random(f"conformance {seed}")
    found: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory(prefix="mesh-motion-prove-") as folder, ExitStack() as stack:
        server = stack.enter_context(ServerProcess(Path(folder), level="error", **_SETTINGS))
        there = Subject(server.endpoint, seconds=_WAIT_SECONDS, opening_seconds=4 * _WAIT_SECONDS)
        subjects = {_SERVER: there}
        subjects |= {name: Subject(client=client, seconds=_WAIT_SECONDS) for name, client in clients().items()}
        for name, subject in subjects.items():
            cases = subject.cases()
            cases = choice(cases, round(budget.count * len(cases) / len(server_cases())), random)
            found[name] = verdict(name, put_to(subject, cases, Budget(len(cases), budget.report)))
    return _result(found)


def _result(found: dict[str, dict[str, Any]]) -> Result:
    failed = [f"{name} {case['id']}" for name, each in found.items() for case in each["failed"]]
    counts = ", ".join(f"{name} {each['cases']}" for name, each in found.items())
    missing = ", ".join(name for name in _PROGRAMS if name not in found)
    text = f"{counts} cases, {len(failed)} failed" + (f"; {missing} not built" if missing else "")
    if failed:
        text = f"{len(failed)} of {sum(each['cases'] for each in found.values())} failed: {', '.join(failed[:3])}"
    return Result(text, not failed, {"parts": found, "not_built": missing})


CHECK = Check(
    "conformance",
    "{count} cases of SPEC.md for the server; each client",
    short=300,
    full=len(server_cases()),
    seconds=40,
    run=run,
)
