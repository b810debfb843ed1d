"""The parent of gateway and workers: starts them, reads their messages, notices their deaths, drains on SIGTERM.

Single-threaded, without sockets of its own. All input comes from its children's channels, as signals, or as the end of
the lifeline. When a child dies, its channel ends at once.
"""

import os
import selectors
import signal
import socket
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from mesh_motion_protocol.ipc_paths import PREFIX, folder_for_sockets
from mesh_motion_protocol.limits import default_limits

from mesh_motion_server import __version__
from mesh_motion_server.failpoints import failpoint
from mesh_motion_server.operation.disk_watch import DiskWatch
from mesh_motion_server.operation.service_manager import ServiceManager
from mesh_motion_server.operation.tally import TALLY
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.attendant import Attendant
from mesh_motion_server.transport.control import Control
from mesh_motion_server.transport.endpoints import Endpoint, EndpointError
from mesh_motion_server.transport.gateway_line import GatewayLine
from mesh_motion_server.transport.processes import Child, adopt_orphans, fork, spawn, stop_signals, wake_on_signals
from mesh_motion_server.transport.protection import Protection
from mesh_motion_server.transport.registry import Registry
from mesh_motion_server.transport.telemetry import log
from mesh_motion_server.transport.watch import Watch

#: Module from which workers are forked. The supervisor does not import it: it loads the numerics.
TEMPLATE = "mesh_motion_server.transport.template"
#: Number of processes in succession that end before their first message: then their imports are broken.
_WORKER_STARTS = 3
#: A worker that has closed its line must end within this time, seconds.
_LEAVE_SECONDS = 5.0
#: The socket for handshake requests of the workers to the gateway.
_HANDSHAKES = "handshakes"
#: ``EX_SOFTWARE`` of sysexits.h: the server cannot work, and a restart will not help.
_DEFECT = 70


class Supervisor:
    """Runs one server.

    Parameters
    ----------
    level : str
        Log level, handed to the children.
    protection : Protection, optional
        The server's keys; without them every user who reaches an endpoint may use it.
    manager : ServiceManager, optional
        The service manager that started the server and gets its status.
    template : str
        Module that the template runs.
    """

    def __init__(
        self,
        settings: ServerSettings,
        level: str,
        protection: Protection | None = None,
        manager: ServiceManager | None = None,
        template: str = TEMPLATE,
    ) -> None:
        self._settings = settings
        self._template_module = template
        self._level = level
        self._selector = selectors.DefaultSelector()
        self._boot = os.urandom(16)
        self._template: Child | None = None
        self._silent_ends = 0
        self._leaving: dict[Child, float] = {}
        self._killed_at: float | None = None
        self._signals = 0
        disk = self._disk = DiskWatch(settings.state_folder)
        self._watch = Watch(settings, level, manager or ServiceManager(""), disk)
        self.boot = self._boot.hex()
        self._private: tempfile.TemporaryDirectory[str] | None = None
        self._protection = protection
        if protection is not None:
            self._private = tempfile.TemporaryDirectory(prefix=PREFIX, dir=folder_for_sockets(_HANDSHAKES))
            self._protection = replace(protection, handshakes=f"ipc://{self._private.name}/{_HANDSHAKES}")
        store = SessionStore(settings.state_folder)
        self._root = store.identity
        for name in store.sweep():
            log().info("swept", session=name)
        self._gateway = GatewayLine(self._selector, settings.endpoint, self._launch_gateway, self._request)
        self._control = Control(
            Registry(store), settings, self._start_session, self._gateway.reply, Protection.access(protection), disk
        )

    # --- the server's life -------------------------------------------------------------------------------------------

    def start(self) -> dict[str, str]:
        """Start gateway, attendants and the template of the workers.

        Raises EndpointError if an endpoint cannot be bound; ProtectionError if it admits or refuses the wrong keys.

        Returns
        -------
        dict
            ``endpoint`` of clients, ``metrics`` and ``monitor``; "" if not configured.
        """
        adopt_orphans()
        self._gateway.start()
        try:
            for attendant in self._watch.attendants:
                self._attend(attendant)
            for attendant in self._watch.attendants:
                attendant.await_word()
        except (EndpointError, OSError):
            self.stop()
            raise
        self._template = self._next_template()
        self._disk.ask()  # its address space would be added to the limit of children forked later
        # a reader of the ready line may stop the server at once
        self._listen(wake_on_signals(*stop_signals()), self._signalled)
        return {"endpoint": self._gateway.endpoint} | {of.name: of.address for of in self._watch.attendants}

    def run(self, lifeline: int | None = None) -> int:
        """Serve until SIGTERM, SIGINT, SIGHUP or the end of ``lifeline``, then drain; returns the exit status."""
        if lifeline is not None:
            self._listen(lifeline, self._lifeline_ended)
        while not self._finished():
            self._receive()
            now = time.monotonic()
            self._control.keep_time(now)
            self._gateway.keep_time(now)
            if now >= self._watch.next_beat:
                self._beat(now)
            if self._killed_at is not None and now >= self._killed_at:
                self._kill_workers()
        return self.stop()

    def _receive(self) -> None:
        """Wait for events and handle them."""
        for key, _ in self._selector.select(self._patience()):
            key.data(key.fileobj)

    def _beat(self, now: float) -> None:
        """Do the work of each second."""
        self._hurry(now)
        if self._template is None and not (self._control.draining or self._workers_fail):
            self._template = self._next_template()  # an earlier start failed because of a lack of processes or memory
        for attendant in self._watch.attendants:
            if attendant.child is None:
                self._attend_again(attendant)
        self._watch.beat(self._control.registry, self._gateway, self._template, draining=self._control.draining)

    def _finished(self) -> bool:
        working = any(live.status != "dead" for live in self._control.registry.live.values())
        return self._gateway.lost or (self._control.draining and not working)

    def _patience(self) -> float:
        own = (self._killed_at, self._watch.next_beat)
        deadlines = (self._control.next_deadline(), self._gateway.next_deadline(), *own)
        return max(0.0, min(d for d in deadlines if d is not None) - time.monotonic())

    def _signalled(self, source: socket.socket) -> None:
        for number in source.recv(64):
            self._signals += number != signal.SIGHUP  # a terminal that is closed sends it more than once
            self._drain("signal")
        if self._signals > 1:
            self._kill_workers()

    def _lifeline_ended(self, source: int) -> None:
        if not os.read(source, 64):
            self._selector.unregister(source)
            self._drain("lifeline")

    def _drain(self, reason: str) -> None:
        """Accept no new session; each worker ends its request and closes its journal. A second signal: stop at once."""
        if self._control.draining:
            return
        log().info("draining", reason=reason)
        failpoint("supervisor.drain")
        self._watch.manager.notify("STOPPING=1")
        self._control.draining = True
        self._watch.next_beat = time.monotonic()
        self._killed_at = time.monotonic() + self._settings.drain_seconds
        for live in self._control.registry.live.values():
            live.child.channel.offer({"order": "drain"})

    def _kill_workers(self) -> None:
        self._killed_at = None
        for live in self._control.registry.live.values():
            if live.status != "dead":
                log().warning("killed", session=live.session, worker=live.child.pid)
                live.child.kill()

    def stop(self) -> int:
        """End the remaining children; returns the exit status."""
        if self._gateway.lost:
            self._kill_workers()
            return _DEFECT
        self._gateway.stop()
        for attendant in self._watch.attendants:
            if attendant.child is not None:
                self._end(attendant.child)
        if self._template is not None:
            self._template.kill()  # it has no state, and may still be importing
            self._end(self._template)
        if self._private is not None:
            self._private.cleanup()
        log().info("stopped")
        return _DEFECT if self._workers_fail else 0

    # --- the gateway -------------------------------------------------------------------------------------------------

    def _launch_gateway(self, endpoint: str) -> Child:
        gateway = spawn("mesh_motion_server.transport.gateway", self._level)
        limits = default_limits() | self._settings.limits()
        limits["max_partitions"] = min(limits["max_partitions"], default_limits()["max_partitions"])
        welcome = {
            "server": f"mesh-motion-server {__version__}",
            "boot": self._boot,
            "limits": limits,
            "durability": self._settings.durability,
        }
        insecure = self._protection is None and not Endpoint.parse(endpoint).is_local
        order = self._order(endpoint) | {"welcome": welcome, "insecure": insecure}
        gateway.channel.offer(order | {"handshake_seconds": self._settings.handshake_seconds})
        return gateway

    def _request(self, peer: bytes, user: str, frame: bytes) -> None:
        self._control.request(peer, user, frame)

    def _order(self, endpoint: str) -> dict[str, Any]:
        """Return the order that gateway and workers share."""
        protection = self._protection.to_order() if self._protection is not None else None
        return {"endpoint": endpoint, "protection": protection}

    # --- the attendants ----------------------------------------------------------------------------------------------

    def _attend(self, attendant: Attendant) -> None:
        """Start an attendant, if configured, without waiting for its report."""
        if attendant.launch() and attendant.child is not None:
            self._listen(attendant.child.channel, lambda _: self._attendant_spoke(attendant))

    def _attendant_spoke(self, attendant: Attendant) -> None:
        """Handle the attendant's report or its end."""
        child = attendant.child
        if child is None or attendant.spoke():
            return
        attendant.child = None
        log().error("monitor_ended", of=attendant.name, code=self._end(child))
        self._attend_again(attendant)

    def _attend_again(self, attendant: Attendant) -> None:
        try:
            self._attend(attendant)
        except OSError as error:
            log().error("no_monitor", of=attendant.name, reason=str(error))

    # --- the workers -------------------------------------------------------------------------------------------------

    def _start_session(self, order: dict[str, Any]) -> Child:
        """Request a worker; it reads the order after the template has imported everything."""
        if self._template is None:
            self._template = self._start_template()
        child = fork(self._template)
        self._watch.worker_started()
        self._listen(child.channel, lambda _: self._worker_spoke(child))
        service = {"settings": self._settings.model_dump_json(), "root": self._root}
        child.channel.offer(order | self._order(self._gateway.endpoint) | service)
        failpoint("supervisor.ordered")
        return child

    def _start_template(self) -> Child:
        template = spawn(self._template_module, self._level, threads=self._settings.threads)
        self._listen(template.channel, lambda _: self._worker_spoke(template))
        return template

    def _next_template(self) -> Child | None:
        """Start a template for the next sessions; if this fails, the next session starts it."""
        try:
            return self._start_template()
        except OSError as error:
            log().error("no_template", reason=str(error))
            return None

    def _worker_spoke(self, child: Child) -> None:
        """Handle all messages of the template or of a worker.

        A worker reports before it replies. All its reports are handled before the next request of a client, because the
        client may already have the reply.
        """
        while child.channel.pending():
            message = child.channel.receive()
            if message is None:
                self._selector.unregister(child.channel)
                self._await_end(child)
                return
            self._reported(child, message)

    def _reported(self, child: Child, message: dict[str, Any]) -> None:
        self._silent_ends, child.spoke = 0, True
        if child.template is not None and message["event"] == "born":
            child.pid = message["pid"]
        TALLY.add(message.pop("tally", None))
        live = self._control.registry.of(child)
        if live is not None:
            failpoint("supervisor.reported")
            self._control.reported(live, message)

    def _await_end(self, child: Child) -> None:
        """Wait for the end of a process whose line has ended, without blocking other work."""
        template = child is self._template
        if template:
            self._template = None
        descriptor = child.exit_descriptor()
        if descriptor is None:
            self._worker_ended(child, template=template)
            return

        def ended(_source: Any) -> None:
            self._selector.unregister(descriptor)
            os.close(descriptor)
            self._leaving.pop(child, None)
            self._worker_ended(child, template=template)

        self._leaving[child] = time.monotonic() + _LEAVE_SECONDS
        self._listen(descriptor, ended)

    def _hurry(self, now: float) -> None:
        """Kill workers that have closed their line but have not ended."""
        for child, deadline in self._leaving.items():
            if deadline <= now:
                child.kill()

    def _worker_ended(self, child: Child, *, template: bool) -> None:
        code = child.reap()
        failpoint("supervisor.worker-ended")
        if not template:
            self._watch.worker_ended(code)
        self._silent_ends += not child.spoke
        live = self._control.registry.of(child)
        if live is not None:
            self._control.gone(live, code)
        elif template:
            log().error("template_ended", code=code)
            if self._template is None and not (self._workers_fail or self._control.draining):
                self._template = self._next_template()
        if self._workers_fail and not self._control.draining:
            log().error("workers_cannot_start", attempts=self._silent_ends, hint="their errors are above this line")
            self._drain("workers cannot start")

    @property
    def _workers_fail(self) -> bool:
        return self._silent_ends >= _WORKER_STARTS

    def _end(self, child: Child) -> int:
        """Close the line to a worker, which makes a waiting one end, and collect its exit status."""
        self._selector.unregister(child.channel)
        return child.reap()

    def _listen(self, source: Any, receive: Callable[[Any], None]) -> None:
        self._selector.register(source, selectors.EVENT_READ, receive)
