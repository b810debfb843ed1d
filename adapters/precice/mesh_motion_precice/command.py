"""``mesh-motion-precice mesh-motion.toml``: the participant as a program."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mesh_motion_client import MeshMotionError, Session, connect

from mesh_motion_precice.api import connect_precice
from mesh_motion_precice.configuration import Configuration, read_configuration
from mesh_motion_precice.participant import Participant, load_mesh, open_session, resume_session

__all__ = ["main", "run"]

_FAILED = 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Couple; 0 when preCICE ended the coupling, 1 with one line to stderr when it could not be done."""
    options = _parser().parse_args(arguments)
    try:
        run(_configuration(options), endpoint=options.server, credentials=options.session, restart=options.restart)
    except MeshMotionError as error:
        sys.stderr.write(f"mesh-motion-precice: {error}\n")
        return _FAILED
    return 0


def run(configuration: Configuration, *, endpoint: str | None, credentials: Path, restart: bool) -> None:
    """Couple from the first window to the last, a line a window to stdout.

    Raises
    ------
    MeshMotionError
    """
    mesh = load_mesh(configuration)
    with connect(endpoint) as server:
        session = (
            resume_session(server, mesh, credentials)
            if restart
            else open_session(server, mesh, configuration, credentials if endpoint else None)
        )
        with session:
            _report_start(session, configuration, restart)
            coupling = connect_precice(configuration.participant, str(configuration.precice_config))
            for window in Participant(coupling, session, mesh, configuration).windows():
                sys.stdout.write(
                    f"window {window.number}  t {window.time:.6g}  {window.iterations} iterations  "
                    f"min size-skew {window.lowest_quality:.3f}  {' '.join(window.warnings)}".rstrip()
                    + "\n"
                )
                sys.stdout.flush()


def _report_start(session: Session, configuration: Configuration, restart: bool) -> None:
    """Which session it is."""
    begun = f"goes on after window {session.step}" if restart else "begins"
    sys.stdout.write(f"{configuration.participant}: session {session.credentials.session} {begun}\n")
    sys.stdout.flush()


def _configuration(options: argparse.Namespace) -> Configuration:
    """The file, with what the command line gives instead."""
    configuration = read_configuration(options.file)
    if options.mesh is not None:
        configuration = replace(configuration, mesh_file=options.mesh)
    if options.config is not None:
        configuration = replace(configuration, precice_config=options.config)
    return configuration


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("mesh-motion-precice", description="A preCICE participant that moves a mesh.")
    parser.add_argument("file", type=Path, help="the participant's TOML file")
    parser.add_argument("--server", help="endpoint of the mesh-motion server; default: a private one, without restart")
    parser.add_argument("--mesh", type=Path, help="mesh file, instead of [mesh] file")
    parser.add_argument("--config", type=Path, help="preCICE's configuration, instead of [precice] config")
    parser.add_argument("--restart", action="store_true", help="go on with the session of --session")
    default = Path("mesh-motion.session")
    parser.add_argument("--session", type=Path, default=default, help="the session's name and secret (%(default)s)")
    return parser
