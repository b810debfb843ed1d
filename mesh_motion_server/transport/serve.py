"""The way in: check where to listen, start the supervisor, say that the server is ready, serve until stopped."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

from mesh_motion_server import __version__
from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.failpoints import activate
from mesh_motion_server.operation.service_manager import ServiceManager
from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.endpoints import Endpoint, EndpointError, lock_folder
from mesh_motion_server.transport.hosting import Hosting
from mesh_motion_server.transport.protection import Protection
from mesh_motion_server.transport.self_test import ProtectionError
from mesh_motion_server.transport.supervisor import Supervisor
from mesh_motion_server.transport.telemetry import configure, log

__all__ = ["EXIT_CONFIGURATION", "EXIT_UNAVAILABLE", "LIFELINE", "serve"]

#: ``EX_CONFIG`` of sysexits.h: the settings ask for something unsafe.
EXIT_CONFIGURATION = 78
#: ``EX_UNAVAILABLE``: the endpoint is taken.
EXIT_UNAVAILABLE = 69
#: Environment variable with the number of an inherited file descriptor: the server drains when it reads as ended. A
#: client that starts a private server holds the other end, so that the server never outlives it.
LIFELINE = "MESH_MOTION_LIFELINE_FD"


def serve(
    settings: ServerSettings,
    *,
    insecure: bool = False,
    ready_file: Path | None = None,
    level: str = "info",
    hosting: Hosting | None = None,
) -> int:
    """Run a server until SIGTERM, SIGINT or the end of its lifeline.

    Parameters
    ----------
    settings : ServerSettings
        ``endpoint`` is ``tcp://HOST:PORT`` (port 0: the system chooses) or ``ipc:///path``. With ``keys_folder`` only
        keys on its allow-list get a connection.
    insecure : bool
        Listen on an address that other machines reach, without encryption and authentication.
    ready_file : Path, optional
        Written, whole at once, when clients may connect: JSON with ``endpoint``, ``metrics`` (empty without),
        ``pid``, ``boot``, ``version``. The same endpoint goes to standard output in one line, ``ready ENDPOINT``.
    level : {"debug", "info", "warning", "error"}
        Of the logs on standard error.
    hosting : Hosting, optional
        Other modules for sessions and their store.

    Returns
    -------
    int
        Exit status: 0 after a drain, 69 if the endpoint is taken, 70 if the gateway or the workers keep falling, 78
        if the endpoint is wrong or unsafe, the keys do not protect it, or there is no such failpoint.
    """
    configure("supervisor", level)
    if ready_file is not None:
        ready_file.unlink(missing_ok=True)
    lifeline = os.environ.pop(LIFELINE, None)
    try:
        protection = Protection.of_folder(settings.keys_folder.expanduser()) if settings.keys_folder else None
        endpoint = _allowed(settings.endpoint, insecure=insecure, protected=protection is not None)
        _check_metrics(settings.metrics, insecure=insecure)
        lock = lock_folder(endpoint)
        failpoints = activate()
    except (EndpointError, InvalidInput) as error:
        log().error("refused", reason=error.message, hint=error.hint)
        return EXIT_CONFIGURATION
    if failpoints is not None:
        log().warning("failpoints", folder=str(failpoints), consequence="this server fails on purpose: a test's")
    settings = settings.model_copy(update={"state_folder": settings.state_folder.expanduser()})
    manager = ServiceManager.of_environment()
    supervisor = Supervisor(settings, hosting or Hosting(), level, protection, manager)
    try:
        where, metrics = supervisor.start()
    except EndpointError as error:
        log().error("refused", reason=error.message, hint=error.hint)
        return EXIT_CONFIGURATION if isinstance(error, ProtectionError) else EXIT_UNAVAILABLE
    _announce(where, metrics, supervisor.boot, ready_file)
    manager.tell("READY=1", f"MAINPID={os.getpid()}")
    try:
        return supervisor.run(int(lifeline) if lifeline else None)
    finally:
        if ready_file is not None:
            ready_file.unlink(missing_ok=True)
        if lock is not None:
            lock.close()


def _allowed(text: str, *, insecure: bool, protected: bool) -> Endpoint:
    """The endpoint, if it is local or protected by keys, or the caller insists."""
    endpoint = Endpoint.parse(text)
    if endpoint.is_local or protected:
        return endpoint
    if not insecure:
        raise EndpointError(
            f"{text} is reached by other machines, and without keys this server neither encrypts nor authenticates",
            hint="give --keys (`mesh-motion keys server DIR` makes them), or listen on 127.0.0.1 or ipc and tunnel "
            "with ssh; --insecure listens there all the same",
        )
    log().warning("insecure", endpoint=text, consequence="whoever reaches this address may open sessions")
    return endpoint


def _check_metrics(address: str | None, *, insecure: bool) -> None:
    """Raise if other machines would reach the metrics, which no key protects, unless the caller insists."""
    if address is None or Endpoint.parse(f"tcp://{address}").is_local:
        return
    if not insecure:
        raise EndpointError(
            f"metrics on {address} would be read by other machines, and keys do not protect them",
            hint="listen on 127.0.0.1 and let something on this machine fetch them; --insecure listens there all the "
            "same",
        )
    log().warning("insecure", metrics=address, consequence="whoever reaches this address may read the metrics")


def _announce(endpoint: str, metrics: str, boot: str, ready_file: Path | None) -> None:
    log().info("ready", endpoint=endpoint, metrics=metrics, pid=os.getpid(), version=__version__)
    sys.stdout.write(f"ready {endpoint}\n")
    sys.stdout.flush()
    if ready_file is not None:
        values = {"endpoint": endpoint, "metrics": metrics, "pid": os.getpid(), "boot": boot}
        text = json.dumps(values | {"version": __version__})
        partial = ready_file.with_name(ready_file.name + ".part")
        partial.write_text(text, encoding="utf-8")
        partial.replace(ready_file)
