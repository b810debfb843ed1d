"""``python -m proofs``: the server's promises, shown."""

# ruff: noqa: PLC0415  (each import when it is needed, so that --help is quick)

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from mesh_motion_protocol.errors import MeshMotionError

from mesh_motion_server.commands.cli import ExitStatus, complain, status_of

__all__ = ["main"]


def prove(
    full: Annotated[bool, typer.Option("--full", help="The counts of a night instead of some minutes.")] = False,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="A check's name; may be given several times."),
    ] = None,
    list_checks: Annotated[bool, typer.Option("--list", help="List the checks and do nothing.")] = False,
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="The same one does the same.")] = 1,
    minutes: Annotated[
        float | None, typer.Option(min=0.01, metavar="M", help="As many as fit in this time, instead of counts.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Receives proof.json.")] = Path("out/prove"),
) -> None:
    """Show that the server keeps its promises: power losses, faults, damage, kills, attacks, nonsense.

    A line for each check: its target, what came of it, the seed that repeats it. Status 1 if one fails. DIR/proof.json
    has every figure, with the machine and all versions.

    \b
    python -m proofs
    python -m proofs --only power-loss --seed 7 --minutes 10
    """
    from mesh_motion_server.files.replace import require_folder_place
    from proofs.runner import Plan, chosen
    from proofs.runner import prove as run_checks
    from proofs.table import CHECKS

    plan = Plan("full" if full else "short", seed, minutes)
    try:
        checks = chosen(CHECKS, only or ())
        if list_checks:
            _report("\n".join(f"{check.name:<15} {check.target_of(check.count(plan.scale))}" for check in checks))
            return
        require_folder_place(out)
        with _ended_by_sigterm(), _progress() as progress:
            passed = run_checks(checks, plan, out, report=_report, progress=progress)
    except MeshMotionError as error:
        complain(str(error))
        raise typer.Exit(status_of(error.code)) from None
    except KeyboardInterrupt:
        complain("interrupted")
        raise typer.Exit(ExitStatus.INTERRUPTED) from None
    if not passed:
        complain(f"a check failed; {out / 'proof.json'} has its traceback or figures")
        raise typer.Exit(ExitStatus.UNMET)


def _report(line: str) -> None:
    """At once, also into a file or pipe."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


@contextmanager
def _ended_by_sigterm() -> Iterator[None]:
    """SIGTERM (of a limit of time, say) is an interrupt like Ctrl-C: the servers and clients of a check end with it."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _progress() -> Iterator[Callable[[str], None]]:
    """What is being done, on a terminal's standard error."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from mesh_motion_server.watch.terminal.console import working

    with working("") as say_what:
        yield say_what


def main() -> None:
    """Run the command line and exit."""
    app = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None, add_completion=False)
    app.command()(prove)
    app(prog_name="python -m proofs")


if __name__ == "__main__":
    main()
