"""The server's own parts in one thread: the effect of a seeded fault on a client, within milliseconds.

Gateway, control, workers and session hosts are the real ones; only the processes between them are missing, and the
model is very cheap.
"""

import contextlib
import itertools
import threading
import time
from collections import deque
from types import SimpleNamespace

import zmq
from mesh_motion_protocol.limits import FRAME_BYTES, HEADER_BYTES, default_limits
from plain_model import PlainModel

from mesh_motion_server.operation.disk_watch import DiskWatch
from mesh_motion_server.service.dispatch import SessionHost
from mesh_motion_server.session.spec import SessionSpec
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import MethodSettings, ServerSettings
from mesh_motion_server.transport.control import Control
from mesh_motion_server.transport.endpoints import bind, router
from mesh_motion_server.transport.gateway import Gateway
from mesh_motion_server.transport.protection import Protection, Rights
from mesh_motion_server.transport.registry import Registry
from mesh_motion_server.transport.worker import Worker
from tests.faults.limited_context import limited_context


class Line:
    """A channel without a process at its other end."""

    def __init__(self, send):
        self.send, self.orders = send, deque()

    def offer(self, message):
        self.send(message)
        return True

    def receive(self):
        return self.orders.popleft() if self.orders else None


class WorkerThere:
    """The supervisor's data of a worker: its child, and here the worker as well."""

    def __init__(self, server, order):
        self.pid, self.server, self.worker = next(server.numbers), server, None
        self.channel = SimpleNamespace(offer=self.obey)
        self.order = order

    def start(self):
        server, order = self.server, self.order
        try:
            host = server.host(order)
        except Exception as error:
            failure = {"event": "failed", "code": getattr(error, "code", "INTERNAL"), "message": str(error)}
            server.later.append((self, failure | {"hint": getattr(error, "hint", ""), "details": {}}))
            server.later.append((self, None))
            return
        socket = router(server.context, message_bytes=FRAME_BYTES, queued=64, handshake_seconds=5.0)
        endpoint = bind(socket, "tcp://127.0.0.1:*")
        self.line = Line(lambda event: server.later.append((self, event)))
        self.worker = Worker(self.line, socket, host, server.settings, Rights(None, order.get("owner", "")))
        serving = {"event": "serving", "endpoint": endpoint, "label": host.label, "partitions": host.partitions}
        self.line.send(serving | {"epoch": host.epoch, "state": str(host.state), "step": host.step})
        self.socket, self.its_host = socket, host

    def obey(self, order):
        self.line.orders.append(order)
        self.worker._obey()

    def kill(self):
        self.end()

    def end(self):
        self.worker.disconnect()
        self.its_host.close()
        self.socket.close(0)
        self.worker = None
        self.server.later.append((self, {"event": "over"}))
        self.server.later.append((self, None))


class InProcessServer:
    """Runs from construction to :meth:`close`."""

    def __init__(self, folder):
        self.settings = ServerSettings.from_mapping(
            {"state_folder": str(folder), "collective_timeout_seconds": 0.3, "lease_seconds": 0.3, "threads": 1}
        )
        self.numbers, self.later, self.workers = itertools.count(1), deque(), []
        self.store = SessionStore(folder)
        self.context = limited_context()
        self.control = Control(
            Registry(self.store),
            self.settings,
            self.start,
            self.reply,
            Protection.access(None),
            DiskWatch(self.settings.state_folder),
        )
        socket = router(self.context, message_bytes=HEADER_BYTES, queued=64, handshake_seconds=5.0)
        self.endpoint = bind(socket, "tcp://127.0.0.1:*")
        welcome = {"server": "in process", "boot": bytes(range(16)), "durability": self.settings.durability}
        welcome["limits"] = default_limits() | self.settings.limits()
        to_control = Line(lambda message: self.control.request(**message))
        self.gateway, self.socket = Gateway(to_control, socket, welcome), socket
        self.over = False
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def host(self, order):
        if order["order"] == "resume":
            given = order["session"], order["token"], self.store
            return SessionHost.resume(*given, limits=self.settings, build_model=PlainModel)
        names = (
            "session",
            "token",
            "dimension",
            "partitions",
            "label",
            "durability",
            "owner",
            "evaluation",
            "time",
            "time_levels",
        )
        spec = SessionSpec(**{name: order[name] for name in names}, settings=MethodSettings(**order["method"]))
        return SessionHost.create(spec, self.store, limits=self.settings, build_model=PlainModel)

    def start(self, order):
        child = WorkerThere(self, order)
        self.workers.append(child)
        child.start()
        return child

    def reply(self, peer, frame):
        self.gateway._send(peer, [frame])

    def run(self):
        while not self.over:
            poller = zmq.Poller()
            poller.register(self.socket, zmq.POLLIN)
            for child in self.workers:
                poller.register(child.socket, zmq.POLLIN) if child.worker else None
            ready = dict(poller.poll(5))
            if self.socket in ready:
                self.gateway._receive()
            for child in [child for child in self.workers if child.worker]:
                if child.socket in ready:
                    child.worker._receive()
                child.worker._keep_time()
                child.worker._report()
                if child.worker._over or child.its_host.closed:
                    child.end()
            self.report()
            self.control.keep_time(time.monotonic())
            self.workers = [child for child in self.workers if child.worker]

    def report(self):
        """The supervisor takes the workers' reports."""
        while self.later:
            child, event = self.later.popleft()
            live = self.control.registry.of(child)
            if live is None:
                continue
            if event is None:
                self.control.gone(live, 0)
            else:
                self.control.reported(live, event)

    def close(self):
        self.over = True
        self.thread.join()
        for child in self.workers:
            with contextlib.suppress(Exception):
                child.end()
        self.socket.close(0)
        self.context.destroy(0)


@contextlib.contextmanager
def in_process_server(folder):
    server = InProcessServer(folder)
    try:
        yield server
    finally:
        server.close()
