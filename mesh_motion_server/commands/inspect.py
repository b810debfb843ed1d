"""``mesh-motion inspect``: the sessions of a running server, or those of a folder, verified once or followed."""

# ruff: noqa: PLC0415

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mesh_motion_server.commands.completions import session_folders
from mesh_motion_server.commands.expected_errors import expected_errors
from mesh_motion_server.commands.options import EndpointOption, KeyOption, ServerKeyOption, keys_of_options
from mesh_motion_server.commands.outcome import ExitStatus, complain, say, say_json, show, status_of

if TYPE_CHECKING:
    from mesh_motion_server.watch.terminal.sources import FolderSource

#: Width of a view that goes to a pipe.
_PLAIN_COLUMNS = 100


def inspect(
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="FOLDER",
            help="A session's folder or a state folder; with --follow by default the state folder of serve.",
            show_default=False,
            autocompletion=session_folders,
        ),
    ] = None,
    step: Annotated[int | None, typer.Option(min=1, metavar="N", help="Describe step N of a session's folder.")] = None,
    follow: Annotated[
        bool,
        typer.Option("--follow", help="Show the state of the folder's sessions, and update it until q is pressed."),
    ] = False,
    session: Annotated[
        str | None,
        typer.Option(
            metavar="ID|LABEL",
            help="With --follow: show the details of this session; the beginning of the id is enough.",
            show_default=False,
        ),
    ] = None,
    every: Annotated[
        float, typer.Option(min=0.1, max=60.0, metavar="S", help="With --follow: seconds between two updates.")
    ] = 1.0,
    endpoint: EndpointOption = None,
    key: KeyOption = None,
    server_key: ServerKeyOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON; with --follow once.")] = False,
    timeout: Annotated[float, typer.Option(metavar="S", min=0.1, help="Seconds to wait for a server.")] = 5.0,
) -> None:
    """List the sessions of a running server, or read stored sessions without changing anything.

    A folder is verified: every checksum of the journal, the mesh and the state. Status 4 means damage.

    \b
    mesh-motion inspect --endpoint tcp://127.0.0.1:7440
    mesh-motion inspect ~/.local/state/mesh-motion
    mesh-motion inspect ~/.local/state/mesh-motion/sessions/0123… --step 1234

    With --follow nothing is verified: a table shows state, step and quality of each session, and for one session also
    iterations, worst cells, warnings and refusals. Only files are read, so sessions of a server that has died are
    shown too. Without a terminal the table is printed once.

    \b
    mesh-motion inspect --follow
    mesh-motion inspect ~/.local/state/mesh-motion --follow --session 0123…
    """
    if follow:
        if endpoint is not None or str(folder).startswith(("tcp:/", "ipc:/")):
            raise typer.BadParameter("expected the state folder of a server, not its endpoint", param_hint="--follow")
        if step is not None:
            raise typer.BadParameter("give either --step or --follow", param_hint="--step")
        _follow(folder, session, every, as_json=as_json)
        return
    from mesh_motion_server.cases.inspect import inspect_folder, inspect_step, list_sessions

    if (folder is None) == (endpoint is None):
        raise typer.BadParameter("give either FOLDER or --endpoint", param_hint="FOLDER")
    if step is not None and folder is None:
        raise typer.BadParameter("a step needs a session's FOLDER", param_hint="--step")
    if session is not None:
        raise typer.BadParameter("needs --follow; without it give the session's FOLDER", param_hint="--session")
    with expected_errors():
        if folder is not None:
            found = inspect_folder(folder) if step is None else inspect_step(folder, step)
        else:
            found = list_sessions(str(endpoint), timeout, keys_of_options(endpoint, key, server_key))
    if as_json:
        say_json(found.values)
    else:
        show(found.table)
    if found.damaged:
        complain(f"damaged: {', '.join(found.damaged)}")
        raise typer.Exit(ExitStatus.FAILED)


def _follow(folder: Path | None, session: str | None, every: float, *, as_json: bool) -> None:
    """Show the sessions of a folder until ``q`` is pressed; once for a program or without a terminal."""
    from mesh_motion_server.settings import ServerSettings
    from mesh_motion_server.watch.terminal.sources import FolderSource, Unreadable

    source = FolderSource((folder or ServerSettings().state_folder).expanduser())
    with expected_errors():
        try:
            if as_json or not _is_terminal():
                _print_once(source, session, as_json=as_json)
            else:
                from mesh_motion_server.watch.terminal.live import watch

                raise typer.Exit(watch(source, session, every))
        except Unreadable as error:
            complain(f"{source.where}: {error}")
            raise typer.Exit(status_of("UNAVAILABLE")) from None


def _is_terminal() -> bool:
    """Return whether keys can be read and a screen can be drawn."""
    return sys.stdin.isatty() and sys.stdout.isatty() and os.environ.get("TERM", "dumb") != "dumb"


def _print_once(source: FolderSource, session: str | None, *, as_json: bool) -> None:
    """Print the state of the sessions now."""
    from mesh_motion_server.watch.terminal.console import console
    from mesh_motion_server.watch.terminal.table import look_at, rendered, values_of

    look = look_at(source, session)
    if as_json:
        say_json(values_of(source.where, look))
        return
    width = None if sys.stdout.isatty() else _PLAIN_COLUMNS
    screen = console(width=width, no_color=True, force_terminal=False)
    with screen.capture() as capture:
        screen.print(rendered(source.where, look))
    say("\n".join(line.rstrip() for line in capture.get().splitlines()))
