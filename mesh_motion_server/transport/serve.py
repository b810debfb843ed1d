"""The entry point: check the endpoint, start the supervisor, report that the server is ready, serve until stopped."""

import importlib.util
import json
import os
import resource
import shutil
import sys
from pathlib import Path
from typing import Self, TextIO

from mesh_motion_protocol.errors import InvalidInput, MeshMotionError, ResourceExhausted
from mesh_motion_protocol.lacks import way_out_of

from mesh_motion_server import __version__
from mesh_motion_server.failpoints import activate
from mesh_motion_server.operation.service_manager import ServiceManager
from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.endpoints import Endpoint, EndpointError, lock_folder
from mesh_motion_server.transport.protection import Protection
from mesh_motion_server.transport.self_test import ProtectionError
from mesh_motion_server.transport.state_folder import StateFolder
from mesh_motion_server.transport.supervisor import TEMPLATE, Supervisor
from mesh_motion_server.transport.telemetry import configure, log

#: ``EX_CONFIG`` of sysexits.h: the settings ask for something unsafe.
EXIT_CONFIGURATION = 78
#: ``EX_UNAVAILABLE``: the endpoint or the state folder is in use, or the disk does not give the state folder.
EXIT_UNAVAILABLE = 69
#: Open files without which no session can be served: sockets, pipes between processes, stored files.
_FEWEST_FILES = 64
#: Environment variable with the number of an inherited file descriptor: the server drains when it reads as ended. A
#: client that starts a private server holds the other end, so that the server never outlives it.
LIFELINE = "MESH_MOTION_LIFELINE_FD"
#: Environment variable with a JSON list of the folders that the client made for its private server. The server removes
#: them at its end, because a client that is killed cannot.
_PRIVATE_FOLDERS = "MESH_MOTION_PRIVATE_FOLDERS"
#: Alternatives to an endpoint for other machines.
_INSTEAD = {
    "metrics": "let a program on this machine fetch them",
    "monitor": "from another machine use a tunnel: `ssh -L 7441:127.0.0.1:7441 HOST`",
}


def serve(
    settings: ServerSettings,
    *,
    insecure: bool = False,
    ready_file: Path | None = None,
    level: str = "info",
    template: str = TEMPLATE,
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
        Written in one piece when clients may connect: JSON with ``endpoint``, ``metrics`` and ``monitor`` (empty
        without), ``pid``, ``boot``, ``version``. The same endpoint goes to standard output in one line,
        ``ready ENDPOINT``.
    level : {"debug", "info", "warning", "error"}
        Level of the logs on standard error.
    template : str
        Module that the template runs; tests use their own.

    Returns
    -------
    int
        Exit status: 0 after a drain, 69 if the endpoint or the state folder is taken, the disk fails, or files,
        processes or memory are lacking, 70 if the gateway or the workers fail repeatedly, 78 if the endpoint or the
        state folder is wrong or unsafe, the keys do not protect it, or a plan of failpoints is wrong.
    """
    configure("supervisor", level)
    lifeline = os.environ.pop(LIFELINE, None)
    private = json.loads(os.environ.pop(_PRIVATE_FOLDERS, "[]"))
    settings = settings.model_copy(update={"state_folder": settings.state_folder.expanduser()})
    manager = ServiceManager.of_environment()
    try:
        _require_files()
        if ready_file is not None:
            _check_ready_file(ready_file)
        protection, lock = _prepare(settings, insecure=insecure)
        state = _hold(settings)
        supervisor, listening = _start(settings, template, level, protection, manager)
        state.name_holder(listening["endpoint"])
    except _RefusedError as refusal:
        return refusal.logged()
    try:
        try:
            _announce(listening, supervisor.boot, ready_file)
        except (_RefusedError, OSError):
            supervisor.stop()
            raise
        manager.notify("READY=1", f"MAINPID={os.getpid()}")
        return supervisor.run(int(lifeline) if lifeline else None)
    except _RefusedError as refusal:
        return refusal.logged()
    finally:
        if ready_file is not None:
            ready_file.unlink(missing_ok=True)
        if lock is not None:
            lock.close()
        state.release()
        for folder in private:
            shutil.rmtree(folder, ignore_errors=True)  # the client may remove it at the same time


class _RefusedError(Exception):
    """The server does not start; has the exit status."""

    def __init__(self, error: MeshMotionError, status: int) -> None:
        super().__init__(error.message)
        self.error = error
        self.status = status

    def logged(self) -> int:
        """The exit status, after a line in the log."""
        log().error("refused", reason=self.error.message, hint=self.error.hint)
        return self.status

    @classmethod
    def no_ready_file(cls, path: Path, error: OSError) -> Self:
        """The refusal of a ready file that cannot be written."""
        return cls(
            ResourceExhausted(
                f"the ready file {path} cannot be written: {error.strerror}",
                hint=way_out_of(error, "name a file in a folder that exists and can be written"),
            ),
            EXIT_UNAVAILABLE,
        )


def _require_files() -> None:
    """Allow this process enough open files. Raises _RefusedError if it may not have so many."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= _FEWEST_FILES:
        return
    if hard != resource.RLIM_INFINITY and hard < _FEWEST_FILES:
        few = ResourceExhausted(
            f"this process may have {hard} files open, expected at least {_FEWEST_FILES}",
            hint="allow more open files: ulimit -n",
        )
        raise _RefusedError(few, EXIT_UNAVAILABLE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (_FEWEST_FILES, hard))


def _check_ready_file(path: Path) -> None:
    """Remove the ready file of an earlier server. Raises _RefusedError if a new one cannot be made."""
    try:
        path.unlink(missing_ok=True)
        (partial := _partial(path)).touch()
        partial.unlink()
    except OSError as error:
        raise _RefusedError.no_ready_file(path, error) from error


def _partial(path: Path) -> Path:
    """The file into which the ready file is written before it gets its name."""
    return path.with_name(path.name + ".part")


def _prepare(settings: ServerSettings, *, insecure: bool) -> tuple[Protection | None, TextIO | None]:
    """Check the keys, if configured, and take the lock on the endpoint's folder."""
    try:
        protection = Protection.of_folder(settings.keys_folder.expanduser()) if settings.keys_folder else None
        endpoint = _allowed(settings.endpoint, insecure=insecure, protected=protection is not None)
        _check_watching("metrics", settings.metrics, insecure=insecure)
        _check_watching("monitor", settings.monitor, insecure=insecure)
        _require_page(settings.monitor)
        lock = lock_folder(endpoint)
        failpoints = activate()
    except (EndpointError, InvalidInput) as error:
        raise _RefusedError(error, EXIT_CONFIGURATION) from error
    if failpoints is not None:
        log().warning("failpoints", folder=str(failpoints), consequence="this server fails on purpose: a test's")
    return protection, lock


def _hold(settings: ServerSettings) -> StateFolder:
    """Take the state folder, and write this server into it as its holder."""
    try:
        state = StateFolder(settings.state_folder)
        state.name_holder(settings.endpoint)
    except EndpointError as error:
        raise _RefusedError(error, EXIT_CONFIGURATION) from error
    except ResourceExhausted as error:
        raise _RefusedError(error, EXIT_UNAVAILABLE) from error
    return state


def _start(
    settings: ServerSettings, template: str, level: str, protection: Protection | None, manager: ServiceManager
) -> tuple[Supervisor, dict[str, str]]:
    """Start; return the endpoints of clients, metrics and page."""
    try:
        supervisor = Supervisor(settings, level, protection, manager, template)
        return supervisor, supervisor.start()
    except OSError as error:
        lacking = ResourceExhausted(
            f"the server cannot start: {error.strerror or error}",
            hint=way_out_of(error, "check the disks of the state folder and of TMPDIR"),
        )
        raise _RefusedError(lacking, EXIT_UNAVAILABLE) from error
    except ResourceExhausted as error:
        raise _RefusedError(error, EXIT_UNAVAILABLE) from error
    except EndpointError as error:
        status = EXIT_CONFIGURATION if isinstance(error, ProtectionError) else EXIT_UNAVAILABLE
        raise _RefusedError(error, status) from error


def _allowed(text: str, *, insecure: bool, protected: bool) -> Endpoint:
    """Return the endpoint if it is local, protected by keys, or explicitly allowed."""
    endpoint = Endpoint.parse(text)
    if endpoint.is_local or protected:
        return endpoint
    if not insecure:
        raise EndpointError(
            f"{text} is reached by other machines, and without keys this server neither encrypts nor authenticates",
            hint="give --keys (`mesh-motion keys server DIR` makes them), or listen on 127.0.0.1 or ipc and tunnel "
            "with ssh; --insecure listens there without protection",
        )
    log().warning("insecure", endpoint=text, consequence="all who reach this address may open sessions")
    return endpoint


def _check_watching(name: str, address: str | None, *, insecure: bool) -> None:
    """Raise if other machines would reach metrics or page, which no key protects, unless the caller insists."""
    if address is None or Endpoint.parse(f"tcp://{address}").is_local:
        return
    if not insecure:
        raise EndpointError(
            f"the {name} on {address} would be read by other machines, and keys do not protect it",
            hint=f"listen on 127.0.0.1; {_INSTEAD[name]}; --insecure listens there without protection",
        )
    log().warning("insecure", **{name: address}, consequence=f"all who reach this address may read the {name}")


def _require_page(address: str | None) -> None:
    """Raise if the page has an address but its packages are not installed."""
    missing = [name for name in ("starlette", "uvicorn") if address and importlib.util.find_spec(name) is None]
    if missing:
        raise EndpointError(
            f"the monitor page needs {' and '.join(missing)}, not installed here",
            hint="pip install 'mesh-motion-server[monitor]', or start without --monitor",
        )


def _announce(listening: dict[str, str], boot: str, ready_file: Path | None) -> None:
    log().info("ready", **listening, pid=os.getpid(), version=__version__)
    sys.stdout.write(f"ready {listening['endpoint']}\n")
    sys.stdout.flush()
    if ready_file is not None:
        text = json.dumps(listening | {"pid": os.getpid(), "boot": boot, "version": __version__})
        try:
            (partial := _partial(ready_file)).write_text(text, encoding="utf-8")
            partial.replace(ready_file)
        except OSError as error:
            raise _RefusedError.no_ready_file(ready_file, error) from error
