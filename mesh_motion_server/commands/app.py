"""The commands of ``mesh-motion``; each command imports its modules only when it runs, so that ``--help`` is quick."""

# ruff: noqa: PLC0415

from __future__ import annotations

import platform
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mesh_motion_server import __version__
from mesh_motion_server.commands.cli import ExitStatus, complain, say, say_json
from mesh_motion_server.commands.completions import session_folders
from mesh_motion_server.commands.convert import convert
from mesh_motion_server.commands.expected_errors import expected_errors
from mesh_motion_server.commands.init import init
from mesh_motion_server.commands.keys import keys as keys_app
from mesh_motion_server.commands.monitor import monitor
from mesh_motion_server.commands.options import EndpointOption, KeyOption, ServerKeyOption, keys_of_options
from mesh_motion_server.commands.play import play
from mesh_motion_server.commands.plot import plot
from mesh_motion_server.commands.serve import serve

if TYPE_CHECKING:
    from rich.console import RenderableType

    from mesh_motion_server.cases.check import CheckReport

__all__ = ["app"]

_EPILOGUE = (
    "Exit status: 0 done, 1 a demand not met (conform) or a session that came out otherwise (play "
    "--from-journal), 2 usage or invalid input, 3 refused (no acceptable mesh), 4 session, limit or storage, 69 no "
    "answer or not installed, 70 defect, 78 wrong or unsafe server settings, 130 interrupted."
)

app = typer.Typer(
    name="mesh-motion",
    help="Move volume meshes with their boundaries: predict the quality, correct the motion, then move.",
    epilog=_EPILOGUE,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
app.add_typer(keys_app, name="keys")
app.command(short_help="Write a mesh in another format.")(convert)
app.command(short_help="Write a case file for a mesh.")(init)
app.command(short_help="Draw runs and meshes for a paper.")(plot)
app.command(short_help="Watch sessions from a terminal.")(monitor)
app.command(short_help="Serve sessions until SIGTERM.")(serve)
app.command(short_help="Drive a session through a case.")(play)


def _print_version(asked: bool) -> None:
    if asked:
        say(f"mesh-motion-server {__version__}, protocol 1.0")
        raise typer.Exit


@app.callback()
def _program(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


def _show(table: RenderableType) -> None:
    """Print a table."""
    from mesh_motion_server.watch.terminal.console import console

    console(soft_wrap=True).print(table)


# --- check -----------------------------------------------------------------------------------------------------------


@app.command(short_help="Check a case or a mesh file.")
def check(
    path: Annotated[Path, typer.Argument(metavar="CASE.toml|MESH", help="A case or a mesh file.", show_default=False)],
    zone: Annotated[str, typer.Option(metavar="NAME", help="The zone of a mesh file that has several.")] = "",
    seconds: Annotated[float, typer.Option(min=0.0, metavar="S", help="Predict a case's motion for so long.")] = 20.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Say what is wrong or odd about a case or a mesh, and what will be refused.

    Roles of the patches, degenerate and inverted cells, duplicated and orphan nodes, a suggested support radius, and
    which step of a case's motion will be refused, why and where: status 3.

    \b
    mesh-motion check case.toml
    mesh-motion check mesh.msh
    """
    from mesh_motion_server.cases.check import check as check_path

    with expected_errors():
        report = check_path(path, zone, seconds=seconds)
    if as_json:
        say_json(_check_values(report))
    else:
        _print_check(report)
    for warning in report.warnings:
        complain(f"warning: {warning}")
    if report.refused:
        complain(report.refused)
        raise typer.Exit(ExitStatus.REFUSED)


def _check_values(report: CheckReport) -> dict[str, Any]:
    """The report as plain values."""
    mesh = report.mesh
    return {
        "path": str(report.path),
        "nodes": len(mesh.points),
        "dimension": mesh.dimension,
        "cells": {name: len(nodes) for name, nodes in mesh.cells.items()},
        "patches": {n: {"role": report.roles.get(n, ""), "nodes": len(ids)} for n, ids in mesh.patches.items()},
        "counts": report.counts,
        "pairs": report.pairs,
        "quality": report.quality,
        "support_radius": report.support_radius,
        "suggested_support_radius": report.suggested_radius,
        "steps_accepted": report.steps,
        "refused": report.refused,
        "warnings": report.warnings,
    }


def _print_check(report: CheckReport) -> None:
    """The report as a table."""
    from mesh_motion_server.watch.terminal.console import Table

    mesh = report.mesh
    cells = ", ".join(f"{len(nodes)} {name}" for name, nodes in mesh.cells.items())
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    box = " × ".join(f"[{a:g}, {b:g}]" for a, b in zip(low, high, strict=True))
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_row("mesh", f"{mesh.path}: {mesh.dimension}D, {len(mesh.points)} nodes, {cells}")
    table.add_row("box", box)
    for name, nodes in mesh.patches.items():
        table.add_row("patch", f"{name}: {len(nodes)} nodes, {report.roles.get(name, 'no role here')}")
    if report.counts:
        table.add_row("nodes", ", ".join(f"{count} {kind}" for kind, count in report.counts.items()))
    for pair in report.pairs:
        table.add_row("periodic", pair)
    table.add_row("quality", ", ".join(f"{name} {value:.3f}" for name, value in report.quality.items()))
    chosen = f"{report.support_radius:g} in the case, " if report.support_radius is not None else ""
    table.add_row("support radius", f"{chosen}{report.suggested_radius:g} suggested")
    if report.steps:
        table.add_row("motion", f"{report.steps} steps are accepted")
    _show(table)
    if not report.refused:
        say(f"usable{' as a case' if report.roles else ' as a mesh'}")


# --- inspect ---------------------------------------------------------------------------------------------------------


@app.command(short_help="List sessions, or judge stored ones.")
def inspect(
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="FOLDER",
            help="A session's folder, or a state folder.",
            show_default=False,
            autocompletion=session_folders,
        ),
    ] = None,
    step: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="What happened at step N of a session's folder.")
    ] = None,
    endpoint: EndpointOption = None,
    key: KeyOption = None,
    server_key: ServerKeyOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
    timeout: Annotated[float, typer.Option(metavar="S", min=0.1, help="Seconds to wait for a server.")] = 5.0,
) -> None:
    """List the sessions of a running server, or look into stored ones without changing anything.

    A folder is judged: every checksum of the journal, the mesh and the state. Status 4 means damage.

    \b
    mesh-motion inspect --endpoint tcp://127.0.0.1:7440
    mesh-motion inspect ~/.local/state/mesh-motion
    mesh-motion inspect ~/.local/state/mesh-motion/sessions/0123… --step 1234
    """
    from mesh_motion_server.cases.inspect import inspect_folder, inspect_step, list_sessions

    if (folder is None) == (endpoint is None):
        raise typer.BadParameter("give either FOLDER or --endpoint", param_hint="FOLDER")
    if step is not None and folder is None:
        raise typer.BadParameter("a step needs a session's FOLDER", param_hint="--step")
    with expected_errors():
        if folder is not None:
            found = inspect_folder(folder) if step is None else inspect_step(folder, step)
        else:
            found = list_sessions(str(endpoint), timeout, keys_of_options(endpoint, key, server_key))
    if as_json:
        say_json(found.values)
    else:
        _show(found.table)
    if found.damaged:
        complain(f"damaged: {', '.join(found.damaged)}")
        raise typer.Exit(ExitStatus.FAILED)


# --- conform ---------------------------------------------------------------------------------------------------------


@app.command(short_help="Check a server or a client against SPEC.md.")
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
    """Check any server, or any client, against protocol/SPEC.md, sentence by sentence; status 1 if one is not met.

    The suite knows the document only. A client is driven through a small program in its own language:
    protocol/conformance/README.md has its contract.

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


# --- demo, version ---------------------------------------------------------------------------------------------------


@app.command(short_help="Play the thesis' cases and a flag.")
def demo(
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Receives pictures and results.")] = Path(
        "out/demo"
    ),
) -> None:
    """Play the thesis' three cases and a flag in a channel, standard against corrected.

    Prints a table and leaves a picture of each case and its results in DIR. It takes about a minute.

    \b
    mesh-motion demo --out out/demo
    """
    from mesh_motion_server.cases.demo import play_demo, table_of
    from mesh_motion_server.files.replace import require_folder_place
    from mesh_motion_server.watch.pictures.page import pictures_are_possible
    from mesh_motion_server.watch.terminal.console import working

    if not pictures_are_possible():
        complain("warning: no pictures without matplotlib: pip install 'mesh-motion-server[plot]'")
    with expected_errors(), working("starting a server") as say_what:
        require_folder_place(out)
        outcomes = play_demo(out, say_what)
    _show(table_of(outcomes))
    for picture in sorted(out.glob("*.png")):
        say(f"see {picture}")


@app.command(short_help="Print versions.")
def version() -> None:
    """Print the versions of the program, its protocol and what it stands on.

    \b
    mesh-motion version
    """
    from importlib.metadata import PackageNotFoundError
    from importlib.metadata import version as installed

    packages = []
    for name in ("numpy", "scipy", "pyzmq"):
        try:
            packages.append(f"{name} {installed(name)}")
        except PackageNotFoundError:
            packages.append(f"{name} not installed")
    say(f"mesh-motion-server {__version__}, protocol 1.0")
    say(f"Python {platform.python_version()}, {', '.join(packages)}")
