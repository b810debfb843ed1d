"""``python -m mesh_motion_conformance``: run the suite without other parts of mesh-motion installed."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from mesh_motion_conformance.command import Subject, conform, listed
from mesh_motion_conformance.presence import Unreachable

__all__ = ["main"]

#: ``EX_UNAVAILABLE`` of sysexits.h.
_UNAVAILABLE = 69


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 all demands met, 1 some demands not met, 2 usage, 69 no answer at the endpoint."""
    parser = argparse.ArgumentParser(prog="mesh_motion_conformance", description="What of SPEC.md holds, by section.")
    whom = parser.add_mutually_exclusive_group(required=True)
    whom.add_argument("--endpoint", default="", help="a server's control endpoint, tcp://HOST:PORT or ipc:///PATH")
    whom.add_argument("--client", default="", metavar="COMMAND", help="a client's driver program, with its arguments")
    parser.add_argument(
        "--only", action="append", default=[], metavar="SECTION", help="10, 10.2, 10.2-MOVE…; repeatable"
    )
    parser.add_argument("--list", action="store_true", help="list the cases and do nothing")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the report as JSON")
    parser.add_argument("--junit", type=Path, metavar="FILE", help="write the report as JUnit XML")
    parser.add_argument("--quiet", "-q", action="store_true", help="print failures and the summary only")
    parser.add_argument("--timeout", type=float, default=10.0, metavar="S", help="longest wait for a reply")
    parser.add_argument(
        "--patience", type=float, default=5.0, metavar="S", help="longest wait for a server's time-outs"
    )
    given = parser.parse_args(arguments)
    subject = Subject(given.endpoint, given.client, given.timeout, given.patience)
    if given.list:
        _print(listed(subject, given.only))
        return 0
    try:
        outcomes = conform(subject, _print, only=given.only, json=given.json, junit=given.junit, quiet=given.quiet)
    except Unreachable as error:
        sys.stderr.write(f"mesh_motion_conformance: {error}\n")
        return _UNAVAILABLE
    return int(any(outcome.verdict == "FAIL" for outcome in outcomes))


def _print(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
