"""``mesh-motion monitor``: sessions watched from a terminal."""

# ruff: noqa: PLC0415

from __future__ import annotations

import json
import os
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mesh_motion_server.commands.cli import ExitStatus, complain, status_of
from mesh_motion_server.commands.options import EndpointOption, KeyOption, ServerKeyOption, keys_of_options

if TYPE_CHECKING:
    from mesh_motion_server.watch.terminal.sources import Source

__all__ = ["monitor"]

_PLAIN_COLUMNS = 100


def monitor(
    folder: Annotated[
        Path | None,
        typer.Argument(metavar="FOLDER", help="A state folder or a session's; serve's own.", show_default=False),
    ] = None,
    endpoint: EndpointOption = None,
    key: KeyOption = None,
    server_key: ServerKeyOption = None,
    session: Annotated[
        str | None, typer.Option(metavar="ID|LABEL", help="Choose it; its id may be shortened.", show_default=False)
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="Print one look as text and end.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one look as JSON and end.")] = False,
    every: Annotated[float, typer.Option(min=0.1, max=60.0, metavar="S", help="Seconds between two looks.")] = 1.0,
) -> None:
    """Watch sessions: state, step, the history of quality, iterations, seconds, worst cells, warnings, refusals.

    A folder is read and nobody asked, so a server that has died is shown as well; a server that is asked (--endpoint,
    with a monitor's key where it has keys) tells no history. Without a terminal, one look is printed.

    \b
    mesh-motion monitor
    mesh-motion monitor ~/.local/state/mesh-motion --session 0123…
    mesh-motion monitor --endpoint tcp://127.0.0.1:7440
    mesh-motion monitor --once --json
    """
    if folder is not None and endpoint is not None:
        raise typer.BadParameter("give either FOLDER or --endpoint", param_hint="FOLDER")
    from mesh_motion_client import MeshMotionError as ClientError

    from mesh_motion_server.errors import MeshMotionError
    from mesh_motion_server.watch.terminal.sources import Unreadable

    try:
        source = _source(folder, endpoint, key, server_key)
        if as_json or once or not _is_terminal():
            _print_once(source, session, as_json=as_json)
        else:
            raise typer.Exit(_watch(source, session, every))
    except (MeshMotionError, ClientError) as error:
        complain(str(error))
        raise typer.Exit(status_of(error.code)) from None
    except Unreadable as error:
        complain(f"{source.where}: {error}")
        raise typer.Exit(status_of(error.code)) from None
    except KeyboardInterrupt:
        raise typer.Exit(ExitStatus.INTERRUPTED) from None


def _source(folder: Path | None, endpoint: str | None, key: Path | None, server_key: str | None) -> Source:
    """Where to look."""
    if endpoint is not None:
        from mesh_motion_server.watch.terminal.endpoint_source import EndpointSource

        return EndpointSource(endpoint, keys_of_options(endpoint, key, server_key))
    from mesh_motion_server.settings import ServerSettings
    from mesh_motion_server.watch.terminal.folder_source import FolderSource

    return FolderSource((folder or ServerSettings().state_folder).expanduser())


def _is_terminal() -> bool:
    """Whether this is a terminal that can be drawn on; Textual draws on standard error."""
    streams = (sys.stdin, sys.stdout, sys.stderr)
    return all(stream.isatty() for stream in streams) and os.environ.get("TERM", "dumb") != "dumb"


def _print_once(source: Source, session: str | None, *, as_json: bool) -> None:
    """One look."""
    from mesh_motion_server.watch.terminal.snapshot import snapshot_text, snapshot_values

    try:
        if as_json:
            # to a terminal nothing of a label that it would obey
            values = snapshot_values(source, session)
            text = json.dumps(values, indent=2, ensure_ascii=sys.stdout.isatty(), allow_nan=False)
        else:
            columns = shutil.get_terminal_size((_PLAIN_COLUMNS, 24)).columns if sys.stdout.isatty() else _PLAIN_COLUMNS
            text = snapshot_text(source, session, columns)
    finally:
        source.close()
    encoding = sys.stdout.encoding or "utf-8"
    sys.stdout.write(text.encode(encoding, "replace").decode(encoding) + "\n")


def _watch(source: Source, session: str | None, every: float) -> int:
    """The live view, until it is left; returns the exit status."""
    from mesh_motion_server.watch.terminal.app import MonitorApp

    app = MonitorApp(source, session, every)
    app.run()
    return int(app.return_code or 0)
