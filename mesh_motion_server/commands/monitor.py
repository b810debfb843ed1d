"""``mesh-motion monitor``: shows sessions on a terminal."""

# ruff: noqa: PLC0415

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mesh_motion_server.commands.cli import ExitStatus, complain, say, say_json, status_of

if TYPE_CHECKING:
    from mesh_motion_server.watch.terminal.sources import FolderSource

__all__ = ["monitor"]

_PLAIN_COLUMNS = 100


def monitor(
    folder: Annotated[
        Path | None,
        typer.Argument(metavar="FOLDER", help="A state folder or a session's; serve's own.", show_default=False),
    ] = None,
    session: Annotated[
        str | None,
        typer.Option(metavar="ID|LABEL", help="Its details; the id may be shortened.", show_default=False),
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="Print one look as text and end.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one look as JSON and end.")] = False,
    every: Annotated[float, typer.Option(min=0.1, max=60.0, metavar="S", help="Seconds between two looks.")] = 1.0,
) -> None:
    """Watch sessions in a table: state, step, quality; of one also iterations, worst cells, warnings, refusals.

    Everything is read from the folder, so that a server that has died is shown as well. The key q quits. Without a
    terminal, one look is printed.

    \b
    mesh-motion monitor
    mesh-motion monitor ~/.local/state/mesh-motion --session 0123…
    mesh-motion monitor --once --json
    """
    from mesh_motion_protocol.errors import MeshMotionError

    from mesh_motion_server.settings import ServerSettings
    from mesh_motion_server.watch.terminal.sources import FolderSource, Unreadable

    if str(folder).startswith(("tcp:/", "ipc:/")):
        raise typer.BadParameter("expected the state folder of a server, not its endpoint", param_hint="FOLDER")
    source = FolderSource((folder or ServerSettings().state_folder).expanduser())
    try:
        if as_json or once or not _is_terminal():
            _print_once(source, session, as_json=as_json)
        else:
            from mesh_motion_server.watch.terminal.live import watch

            raise typer.Exit(watch(source, session, every))
    except MeshMotionError as error:
        complain(str(error))
        raise typer.Exit(status_of(error.code)) from None
    except Unreadable as error:
        complain(f"{source.where}: {error}")
        raise typer.Exit(status_of("UNAVAILABLE")) from None
    except KeyboardInterrupt:
        raise typer.Exit(ExitStatus.INTERRUPTED) from None


def _is_terminal() -> bool:
    """Return whether keys can be read and a screen can be drawn."""
    return sys.stdin.isatty() and sys.stdout.isatty() and os.environ.get("TERM", "dumb") != "dumb"


def _print_once(source: FolderSource, session: str | None, *, as_json: bool) -> None:
    """Print one look."""
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
