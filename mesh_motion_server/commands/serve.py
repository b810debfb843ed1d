"""``mesh-motion serve``: the server's settings from a file and from options."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from mesh_motion_protocol.errors import MeshMotionError

from mesh_motion_server.commands.completions import log_levels
from mesh_motion_server.commands.outcome import ExitStatus, complain


def serve(
    endpoint: Annotated[
        str | None,
        typer.Option(
            metavar="ENDPOINT",
            help="tcp://HOST:PORT (0: any free port) or ipc:///PATH; by default tcp://127.0.0.1:7440.",
        ),
    ] = None,
    state: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for the stored sessions; by default ~/.local/state/mesh-motion."),
    ] = None,
    keys: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Key folder: admit only the keys in DIR/allow.toml.")
    ] = None,
    insecure: Annotated[
        bool, typer.Option("--insecure", help="Listen on addresses that other machines reach, without protection.")
    ] = False,
    metrics: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="Serve metrics for Prometheus and health probes over HTTP.")
    ] = None,
    monitor: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="Show the sessions in a browser, read-only.")
    ] = None,
    ready_file: Annotated[
        Path | None, typer.Option(metavar="FILE", help="File to write when clients may connect.")
    ] = None,
    threads: Annotated[
        int | None, typer.Option(metavar="N", help="Threads of each worker; 0, the default: one per core.")
    ] = None,
    settings_file: Annotated[
        Path | None, typer.Option("--settings", metavar="FILE.toml", help="File with all other settings and limits.")
    ] = None,
    log_level: Annotated[
        str,
        typer.Option(
            metavar="LEVEL", help="Lowest level to log: debug, info, warning or error.", autocompletion=log_levels
        ),
    ] = "info",
) -> None:
    """Serve sessions until SIGTERM; then finish the running requests, and keep every session so that it can be resumed.

    The server listens on this machine only, except with --keys (`mesh-motion keys` makes them) or --insecure. The log
    goes to standard error as JSON, and one line "ready ENDPOINT" to standard output.

    \b
    mesh-motion serve
    mesh-motion serve --endpoint ipc:///run/user/1000/mesh-motion --state ~/sessions --metrics 127.0.0.1:9464
    mesh-motion serve --monitor 127.0.0.1:7441
    mesh-motion serve --endpoint tcp://0.0.0.0:7440 --keys keys
    """
    from mesh_motion_server.transport.processes import use_repeatable_libraries

    use_repeatable_libraries()
    from mesh_motion_server.transport.serve import serve as serve_sessions

    levels = ("debug", "info", "warning", "error")
    if log_level not in levels:
        raise typer.BadParameter(f"one of {', '.join(levels)}", param_hint="--log-level")
    given = {
        "endpoint": endpoint,
        "state_folder": str(state) if state else None,
        "metrics": metrics,
        "monitor": monitor,
        "threads": threads,
        "keys_folder": str(keys) if keys else None,
    }
    settings = _server_settings(settings_file, {key: value for key, value in given.items() if value is not None})
    status = serve_sessions(settings, insecure=insecure, ready_file=ready_file, level=log_level)
    raise typer.Exit(status)


def _server_settings(file: Path | None, given: dict[str, Any]) -> Any:
    """Combine the settings of a file and the options, which take precedence; invalid ones end with status 78."""
    import tomllib

    from mesh_motion_server.settings import ServerSettings
    from mesh_motion_server.toml import read_toml

    try:
        values = read_toml(file.read_text(encoding="utf-8")) if file is not None else {}
        return ServerSettings.from_mapping(values | given)
    except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        complain(f"{file}: not readable as TOML: {error}")
    except MeshMotionError as error:
        complain(f"{file}: {error}" if file is not None else str(error))
    raise typer.Exit(ExitStatus.CONFIGURATION)
