"""``mesh-motion conform``: a server or a client against SPEC.md."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mesh_motion_server.commands.expected_errors import expected_errors
from mesh_motion_server.commands.options import EndpointOption
from mesh_motion_server.commands.outcome import ExitStatus, complain, say


def conform(
    endpoint: EndpointOption = None,
    client: Annotated[
        str | None, typer.Option(metavar="COMMAND", help="A client's driver program, with its arguments.")
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option(metavar="SECTION", help="A section or the beginning of a case's id; repeatable.")
    ] = None,
    list_cases: Annotated[bool, typer.Option("--list", help="List the cases and do nothing.")] = False,
    json_file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write the report as JSON.")] = None,
    junit: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the report as JUnit XML.")] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print failures and the summary only.")] = False,
    timeout: Annotated[float, typer.Option(metavar="S", min=0.1, help="Longest wait for a reply.")] = 10.0,
    patience: Annotated[float, typer.Option(metavar="S", help="Longest wait for a server's own time-outs.")] = 5.0,
) -> None:
    """Check a server or a client against the requirements of protocol/SPEC.md; status 1 if a requirement is not met.

    The suite uses nothing but this document. A client is checked through a small driver program in its language;
    protocol/conformance/README.md describes this program.

    \b
    mesh-motion conform --endpoint tcp://127.0.0.1:7440 --quiet
    mesh-motion conform --endpoint tcp://127.0.0.1:7440 --only 16 --only 11.3 --json report.json
    mesh-motion conform --client "python -m mesh_motion_client.conformance"
    """
    from mesh_motion_conformance.command import Subject, listed
    from mesh_motion_conformance.command import conform as put_cases
    from mesh_motion_conformance.presence import Unreachable

    from mesh_motion_server.files.replace import require_file_place

    if (endpoint is None) == (client is None):
        raise typer.BadParameter("give either --endpoint or --client", param_hint="--endpoint")
    subject = Subject(endpoint or "", client or "", timeout, patience)
    if list_cases:
        say(listed(subject, only or ()))
        return
    with expected_errors():
        for report in (json_file, junit):
            if report is not None:
                require_file_place(report)
    try:
        outcomes = put_cases(subject, say, only=only or (), json=json_file, junit=junit, quiet=quiet)
    except Unreachable as error:
        complain(str(error))
        raise typer.Exit(ExitStatus.UNAVAILABLE) from None
    if any(outcome.verdict == "FAIL" for outcome in outcomes):
        raise typer.Exit(ExitStatus.UNMET)
