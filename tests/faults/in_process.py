"""A whole server in one process: gateway, control and workers are the real ones, but calls replace the sockets between
them.

Frames go in and out at an endpoint, through the same code as over a network: decoding, rights, control, registry, host,
encoding. Only sockets, processes and the disk are replaced. So tens of thousands of requests a minute are possible, and
a worker can be killed or a disk can fail between any two of them.
"""

import contextlib
import logging
import os
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from mesh_motion_protocol.errors import DataLoss
from mesh_motion_protocol.limits import FRAME_BYTES, HEADER_BYTES, default_limits

from mesh_motion_server.operation.disk_watch import DiskWatch
from mesh_motion_server.security.allow_list import Entry, write_entries
from mesh_motion_server.service.dispatch import SessionHost
from mesh_motion_server.session.journal.relaxed import RelaxedKeeper
from mesh_motion_server.session.model import build_motion_model
from mesh_motion_server.session.replay import silent
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport import template
from mesh_motion_server.transport import worker as workers
from mesh_motion_server.transport.control import Control
from mesh_motion_server.transport.gateway import Gateway
from mesh_motion_server.transport.protection import Protection, Rights
from mesh_motion_server.transport.registry import Registry
from tests.faults.in_process_parts import Child, Frame, Held, Line, Replies, Socket
from tests.faults.model_files import ModelFiles

ROOT = Path("/model")
#: Name → public key of those on the allow-list; "unlisted" is not.
USERS = {name: letter * 40 for name, letter in
         {"owner": "0", "stranger": "1", "monitor": "2", "admin": "3", "unlisted": "4"}.items()}  # fmt: skip
_ROLES = {"owner": "owner", "stranger": "owner", "monitor": "monitor", "admin": "admin"}


def allow_everybody_listed(folder: Path) -> Protection:
    """Write an allow-list with all users except the unlisted one."""
    path = folder / "allow.toml"
    write_entries(path, {USERS[name]: Entry(name, (role,)) for name, role in _ROLES.items()})
    hour_ago = time.time() - 3600  # else it counts as being written, and is read at every request
    os.utime(path, (hour_ago, hour_ago))
    return Protection("", str(path))


@contextlib.contextmanager
def quiet() -> Iterator[deque[str]]:
    """Collect no logs, but the last exceptions that ended requests, without those that a row has injected."""
    found: deque[str] = deque(maxlen=10)
    logger, handler = logging.getLogger("mesh_motion_server"), _Collecting(found)
    propagate, logger.propagate = logger.propagate, False
    logger.addHandler(handler)
    try:
        yield found
    finally:
        logger.removeHandler(handler)
        logger.propagate = propagate


class _Collecting(logging.Handler):
    """Keeps the text of logged exceptions; the exception itself would keep the whole server in memory."""

    def __init__(self, found: deque[str]) -> None:
        super().__init__()
        self._found = found

    def emit(self, record: logging.LogRecord) -> None:
        error = record.exc_info[1] if record.exc_info else None
        if error is not None and str(error) != "injected":
            place = traceback.extract_tb(error.__traceback__)[-1]
            self._found.append(f"{type(error).__name__}: {error}, in {place.name}, {Path(place.filename).name}")


class _Worker(workers.Worker):
    """A worker that serves its messages; its lease ends on a call."""

    wire: Socket
    line: Line
    host: Any
    held: Held

    def serve(self, frames: list[Frame]) -> None:
        self.wire.incoming.append(frames)
        self._receive()
        self._report()

    def wake(self) -> None:
        """Make the worker report the session's state, as after some seconds without requests."""
        self._report()

    def obey(self, order: dict[str, Any]) -> None:
        self.line.order = order
        self._obey()

    def end_lease(self) -> None:
        """End the lease, as after its time without a connected client."""
        self._suspended = True
        self._send(self.host.suspend())
        self._report()

    def expire(self, now: float) -> None:
        """Run the timers until this time."""
        self._send(self.host.expire(now))


class _Control(Control):
    """Control without the delay before NOT_FOUND."""

    def hurry(self) -> None:
        while self._later.waiting:
            _, peer, frame = self._later.waiting.popleft()
            self._send(peer, frame)


class _Hosts:
    """Makes hosts whose clock stands still until it is moved."""

    def __init__(self, clock: Callable[[], float], build_model: Any) -> None:
        self._options: dict[str, Any] = {"clock": clock, "build_model": build_model or build_motion_model}

    def create(self, spec: Any, store: Any, *, limits: ServerSettings) -> SessionHost:
        return SessionHost.create(spec, store, limits=limits, **self._options)

    def resume(self, session: str, token: bytes, store: Any, *, limits: ServerSettings, progress: Any) -> SessionHost:
        return SessionHost.resume(session, token, store, limits=limits, progress=progress, **self._options)


class InProcessServer:
    """A server with keys and its disk.

    ``protection``: its allow-list; ``build_model``: None for the real numerics. ``now``: time of the hosts, seconds;
    ``ended``: by session, the host of the last worker with a normal end: it must refuse further requests.
    """

    def __init__(self, protection: Protection | None, build_model: Any, settings: ServerSettings) -> None:
        self.files = ModelFiles()
        self.now = 0.0
        self.ended: dict[str, Any] = {}
        self._protection = protection
        self._settings = settings
        self._hosts: Any = _Hosts(lambda: self.now, build_model)
        self._children: dict[Child, _Worker] = {}
        self._todo: deque[tuple[Child, dict[str, Any] | None]] = deque()
        self.start()

    # --- its life ----------------------------------------------------------------------------------------------------

    def start(self) -> None:
        """A new supervisor and gateway, over whatever is on the disk."""
        self._wire, self.endpoint = self._bound(HEADER_BYTES)
        access = Protection.access(self._protection)
        registry = Registry(SessionStore(ROOT, files=self.files))
        disk = DiskWatch(self._settings.state_folder)
        self._control = _Control(registry, self._settings, self._start_worker, self._to_peer, access, disk)
        welcome = {
            "server": "in-process",
            "boot": bytes(16),
            "limits": default_limits() | self._settings.limits(),
            "durability": list(self._settings.durability),
        }
        line = Line(lambda m: self._control.request(m["peer"], m["user"], m["frame"]))
        self._gateway = Gateway(line, self._wire, welcome, protection=self._protection)  # type: ignore[arg-type]

    def stop(self) -> None:
        """Stop with SIGTERM and start again: every worker closes its journal."""
        for worker in list(self._children.values()):
            worker.host.close()
            self.ended[worker.host.session] = worker.host
            worker.held.end()
        self._children.clear()
        self.start()

    def crash(self) -> None:
        """Kill all processes at once, and start new ones."""
        self.halt()
        self.files.handles.clear()
        self._children.clear()
        self.start()

    def halt(self) -> None:
        for worker in self._children.values():
            _end_thread(worker.host)

    def kill(self, session: str) -> None:
        self._todo.append((self._child(session), None))
        self._work()

    # --- its endpoints -----------------------------------------------------------------------------------------------

    def control(self, user: str, peer: bytes, frames: Sequence[Any]) -> Replies:
        """Send a message to the control endpoint; return all its replies."""
        self._gateway._take(peer, USERS[user], [bytes(frame) for frame in frames])
        self._work()
        replies: Replies = self._wire.take_sent()
        return replies

    def data(self, session: str, user: str, peer: bytes, frames: Sequence[Any]) -> Replies:
        """Send a message to a session's data endpoint; return all its replies; KeyError without a worker."""
        received = [Frame(bytes(frame), USERS[user]) for frame in (peer, *frames)]
        return self._replies(session, lambda worker: worker.serve(received))

    def settle(self, session: str) -> None:
        """Wait until a session of level "relaxed" has stored its steps, or the disk has failed; all clients get a
        report.
        """
        keeper = _keeper(self.host(session))
        if keeper is not None:
            with contextlib.suppress(DataLoss):
                keeper.catch_up()
            self._children[self._child(session)].wake()

    def host(self, session: str) -> Any:
        """The host of a session with a living worker, else None."""
        child = self._control.registry.live.get(session)
        worker = self._children.get(child.child) if child else None  # type: ignore[call-overload]
        return worker.host if worker else None

    def end_lease(self, session: str) -> Replies:
        return self._replies(session, _Worker.end_lease)

    def wait(self, session: str, seconds: float) -> Replies:
        self.now += seconds
        return self._replies(session, lambda worker: worker.expire(self.now))

    # --- inside ------------------------------------------------------------------------------------------------------

    def _bound(self, message_bytes: int) -> tuple[Any, str]:
        """A socket that takes frames of so many bytes, and its endpoint."""
        return Socket(), "inproc://nowhere"

    def _replies(self, session: str, do: Callable[[_Worker], None]) -> Replies:
        """Do this to a session's worker; return its messages after all consequences."""
        child = self._child(session)
        worker = self._children[child]
        do(worker)
        if worker.host.closed:
            self._over(child)
        self._work()
        return worker.wire.take_sent()

    def _child(self, session: str) -> Child:
        child: Any = self._control.registry.live[session].child
        if child not in self._children:
            raise KeyError(session)
        return child  # type: ignore[no-any-return]

    def _to_peer(self, peer: bytes, frame: bytes) -> None:
        self._gateway._send(peer, [frame])

    def _start_worker(self, order: dict[str, Any]) -> Any:
        child = Child(lambda child, order: self._todo.append((child, order)))
        self._todo.append((child, order))
        return child

    def _work(self) -> None:
        """Process orders, deaths and their consequences until nothing is left; then send the delayed NOT_FOUND
        replies.
        """
        while self._todo:
            child, order = self._todo.popleft()
            if order is None:
                self._killed(child)
            elif order["order"] == "reclaim":
                self._children[child].obey(order)
            else:
                self._begin(child, order)
        self._control.hurry()

    def _begin(self, child: Child, order: dict[str, Any]) -> None:
        held = Held(self.files)
        try:
            host = template._host(order, self._hosts, SessionStore(ROOT, files=held), self._settings, silent)
        except Exception as error:
            held.end()
            self._reported(child, {"event": "failed"} | template._failure(error))
            self._gone(child, 1)
            return
        line, (wire, endpoint) = Line(lambda event: self._reported(child, event)), self._bound(FRAME_BYTES)
        rights = Rights(self._protection, order["owner"])
        worker = _Worker(line, wire, host, self._settings, rights)  # type: ignore[arg-type]
        worker.wire, worker.line, worker.host, worker.held = wire, line, host, held
        self._children[child] = worker
        serving = {"event": "serving", "endpoint": endpoint, "label": host.label}
        about = {"partitions": host.partitions, "epoch": host.epoch, "state": str(host.state), "step": host.step}
        self._reported(child, serving | about)

    def _over(self, child: Child) -> None:
        worker = self._children.pop(child)
        self._reported(child, {"event": "over", "closed": True})
        self.ended[worker.host.session] = worker.host
        worker.held.end()
        self._gone(child, 0)

    def _killed(self, child: Child) -> None:
        worker = self._children.pop(child, None)
        if worker is not None:
            _end_thread(worker.host)
            worker.held.end()
            self._gone(child, -9)

    def _reported(self, child: Child, event: dict[str, Any]) -> None:
        live = self._control.registry.of(child)  # type: ignore[arg-type]
        if live is not None:
            self._control.reported(live, event)

    def _gone(self, child: Child, code: int) -> None:
        live = self._control.registry.of(child)  # type: ignore[arg-type]
        if live is not None:
            self._control.gone(live, code)


def _keeper(host: Any) -> RelaxedKeeper | None:
    """For a built session of level "relaxed"."""
    built = host._session._built if host is not None else None
    return built.keeper if built is not None and isinstance(built.keeper, RelaxedKeeper) else None


def _end_thread(host: Any) -> None:
    """A killed process has no threads any more."""
    keeper = _keeper(host)
    if keeper is not None and keeper._thread is not None:
        with keeper._news:
            keeper._over = True
            keeper._news.notify_all()
        keeper._thread.join()


def standing_of(host: Any) -> tuple[Any, ...]:
    """All values that a refused request must not change, without waiting requests and kept replies."""
    session = host._session
    now = session._now
    points = [None if x is None else (x.step, x.points.tobytes()) for x in (now.committed, now.trial)]
    return (now.state, session.epoch, session.iteration, now.trial_lost, session.upload.nbytes, *points,
            tuple(sorted(host._holders._peers.items())), host._discard, host.closed)  # fmt: skip
