"""``mesh-motion-precice mesh-motion.toml``: the participant as a program."""

from __future__ import annotations

import argparse
import logging
import os
import sys
import traceback
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

from mesh_motion_client import MeshMotionError, Session, connect

from mesh_motion_precice.api import connect_precice
from mesh_motion_precice.configuration import Configuration, read_configuration
from mesh_motion_precice.participant import Participant, Window, load_mesh, resume_session
from mesh_motion_server.watch.terminal.text import plain

__all__ = ["main", "run"]

_LOG = logging.getLogger(__name__)
#: As a shell says it of a program that Ctrl-C ended.
#: 128 + SIGINT, as shells report it.
_INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Couple; return 0 when preCICE ended the coupling, 1 with one line to stderr when the coupling failed."""
    options = _parser().parse_args(arguments)
    logging.basicConfig(level=options.log_level.upper(), format="%(message)s", stream=sys.stdout)
    try:
        run(
            _configuration(options),
            endpoint=options.server,
            compute_timeout=options.compute_timeout,
            credentials=options.session,
            restart=options.restart,
        )
    except BaseException as error:
        _LOG.debug("it ended here:", exc_info=True)
        _end_without_finalizing(error)
    return 0


def _end_without_finalizing(error: BaseException) -> NoReturn:
    """Print the error and end the process, while the error's frames still hold preCICE's participant.

    The participant's destructor would finalize, and with ``wait-in-finalize`` wait for participants that wait for this
    one. The end of the process ends their connections.
    """
    if isinstance(error, KeyboardInterrupt):
        said = "interrupted; the session stays at its last committed window"
    elif isinstance(error, RuntimeError):  # what the bindings raise for an error of preCICE
        said = f"preCICE: {' '.join(str(error).split())}"
    elif isinstance(error, MeshMotionError):
        said = str(error)
    else:
        said = "".join(traceback.format_exception(error)).rstrip()
    sys.stdout.flush()
    lines = "\n".join(map(plain, said.split("\n")))  # a server's message may hold what a client has sent
    sys.stderr.write(f"mesh-motion-precice: {lines}\n")
    sys.stderr.flush()
    os._exit(_INTERRUPTED if isinstance(error, KeyboardInterrupt) else 1)


def run(
    configuration: Configuration, *, endpoint: str | None, compute_timeout: float, credentials: Path, restart: bool
) -> None:
    """Couple from the first window to the last, with one line in the log for each window.

    Raises
    ------
    MeshMotionError
    RuntimeError
        preCICE's own.
    """
    mesh = load_mesh(configuration)
    coupling = connect_precice(configuration.participant, str(configuration.precice_config))
    participant = Participant(coupling, mesh, configuration)
    with connect(endpoint, compute_timeout=compute_timeout) as server:
        if restart:
            session = resume_session(server, mesh, credentials)
        else:
            label, scheme = f"preCICE {configuration.participant}", configuration.velocity_scheme
            levels = scheme if scheme != "bdf1" else ""
            session = server.open(mesh, configuration.method, label=label, time_levels=levels)
        with session:
            begun = f"goes on after window {session.step}" if restart else "begins"
            _LOG.info("%s: session %s %s", configuration.participant, session.credentials.session, begun)
            _begin(participant, session, restart)
            if endpoint and not restart:
                session.credentials.save(credentials)
            for window in participant.windows():
                _LOG.info("%s", _line(window))


def _begin(participant: Participant, session: Session, restart: bool) -> None:
    """Begin the coupling; if this fails, a new session is deleted, and the file of an earlier session stays."""
    try:
        participant.begin(session)
    except BaseException:
        if not restart:
            session.close("discard")
        raise


def _line(window: Window) -> str:
    """The log's line about a window."""
    return (
        f"window {window.number}  t {window.time:.6g}  {window.iterations} iterations  "
        f"min size-skew {window.lowest_quality:.3f}  {' '.join(window.warnings)}"
    ).rstrip()


def _configuration(options: argparse.Namespace) -> Configuration:
    """The file's configuration, with the values that the command line replaces."""
    configuration = read_configuration(options.file)
    if options.mesh is not None:
        configuration = replace(configuration, mesh_file=options.mesh)
    if options.config is not None:
        configuration = replace(configuration, precice_config=options.config)
    return configuration


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("mesh-motion-precice", description="A preCICE participant that moves a mesh.")
    default = Path("precice-adapter-config.json")
    parser.add_argument("file", type=Path, nargs="?", default=default, help="the participant's file (%(default)s)")
    parser.add_argument("--server", help="endpoint of the mesh-motion server; default: a private one, without restart")
    parser.add_argument(
        "--compute-timeout",
        type=float,
        default=1800.0,
        metavar="SECONDS",
        help="longest wait for an answer (%(default)s)",
    )
    parser.add_argument("--mesh", type=Path, help="mesh file, instead of [mesh] file")
    parser.add_argument("--config", type=Path, help="preCICE's configuration, instead of [precice] config")
    parser.add_argument("--restart", action="store_true", help="continue the session of --session")
    session = Path("mesh-motion.session")
    parser.add_argument("--session", type=Path, default=session, help="the session's name and secret (%(default)s)")
    levels = ("debug", "info", "warning")
    parser.add_argument("--log-level", choices=levels, default="info", help="level of the log on stdout (%(default)s)")
    return parser
