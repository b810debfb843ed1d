"""What the supervisor looks at every second: children, disk, memory; and whom it tells: monitor, systemd, the log.

Its own loop calls :meth:`Watch.beat`, so that whoever listens learns that the loop turns.
"""

from __future__ import annotations

import platform
import time
from collections import Counter

from mesh_motion_protocol import PROTOCOL_VERSION

from mesh_motion_server import __version__
from mesh_motion_server.operation.readiness import Standing
from mesh_motion_server.operation.room import DiskRoom, available_memory, disk_room, resident_bytes
from mesh_motion_server.operation.service_manager import ServiceManager
from mesh_motion_server.operation.tally import TALLY
from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.endpoints import Endpoint, EndpointError
from mesh_motion_server.transport.processes import Child, spawn
from mesh_motion_server.transport.registry import Registry
from mesh_motion_server.transport.telemetry import log, tell_suppressed

__all__ = ["Watch"]

_SECONDS = 1.0
#: A spare worker imports and warms up in some ten seconds; in minutes where kernels are compiled anew.
_SPARE_SECONDS = 300.0
#: The log warns when so many times the reserve is left.
_WARNED = 2
#: A monitor that falls more often has a reason that restarting does not cure.
_STARTS = 20
_MAKE_ROOM = "make room: below the reserve new sessions are refused"
#: Of a session with a worker.
_STATES = ("NEW", "OPENING", "READY", "TRIAL", "COMMITTING", "SUSPENDED", "FROZEN", "FAILED")

_Gauges = list[tuple[str, str, float]]


class Watch:
    """Sees and tells how the server stands.

    Parameters
    ----------
    settings : ServerSettings
    level : str
        Log level, handed to the monitor.
    manager : ServiceManager
    """

    def __init__(self, settings: ServerSettings, level: str, manager: ServiceManager) -> None:
        self.monitor: Child | None = None
        self.manager = manager
        self.address = f"tcp://{settings.metrics}" if settings.metrics else ""
        self.next_beat = time.monotonic() + _SECONDS
        self._settings = settings
        self._level = level
        self._starts = 0
        self._asked_gateway = False
        self._gateway_at = time.monotonic()
        self._warm = False
        self._spare: tuple[Child | None, float] = (None, time.monotonic())
        self._disk_low = False

    # --- the monitor -------------------------------------------------------------------------------------------------

    def start_monitor(self) -> bool:
        """Start the process that answers over HTTP, where there shall be one; whether it runs.

        Raises
        ------
        EndpointError
            If its address cannot be bound.
        """
        if not self.address or self._starts >= _STARTS:
            return False
        self._starts += 1
        where = Endpoint.parse(self.address)
        monitor = spawn("mesh_motion_server.transport.monitor", self._level)
        version = ".".join(map(str, PROTOCOL_VERSION))
        build = {"version": __version__, "protocol": version, "python": platform.python_version()}
        host = "127.0.0.1" if where.host == "localhost" else where.host.strip("[]")
        monitor.channel.send(
            {"host": host, "port": where.port, "build": build, "stuck_seconds": self._settings.stuck_seconds}
        )
        answer = monitor.channel.receive()
        if answer is None or answer["event"] != "bound":
            monitor.reap()
            reason = answer["reason"] if answer else "the monitor ended"
            raise EndpointError(
                f"cannot listen for metrics on {self._settings.metrics}: {reason}", hint="use another address"
            )
        self.address, self.monitor = f"tcp://{answer['address']}", monitor
        return True

    # --- what happens ------------------------------------------------------------------------------------------------

    def gateway_started(self) -> None:
        """It has said that it listens."""
        TALLY.count("gateway_starts")
        self._gateway_at, self._asked_gateway = time.monotonic(), False

    def gateway_answered(self) -> None:
        """Its loop turns."""
        self._gateway_at, self._asked_gateway = time.monotonic(), False

    def worker_started(self) -> None:
        """A worker, spare or not."""
        TALLY.count("worker_starts")

    def worker_ended(self, code: int) -> None:
        """With this exit status, negative after a signal."""
        TALLY.count("worker_ends", label="orderly" if code == 0 else "signal" if code < 0 else "failure")

    def worker_warm(self) -> None:
        """A worker has loaded the kernels."""
        self._warm = True

    # --- every second ------------------------------------------------------------------------------------------------

    def beat(self, registry: Registry, gateway: Child | None, spare: Child | None, *, draining: bool) -> None:
        """Look and tell."""
        now = time.monotonic()
        self.next_beat = now + _SECONDS
        tell_suppressed()
        if gateway is not None and not self._asked_gateway:
            self._asked_gateway = gateway.channel.offer({"order": "ping"})
        if spare is not self._spare[0]:
            self._spare = (spare, now)
        standing = self._standing(now, draining=draining)
        self._log_disk(standing.disk)
        missing = standing.missing()
        if not standing.gateway_silent:
            self.manager.tell("WATCHDOG=1", f"STATUS={registry.working()} sessions{missing and '; ' + missing}")
        if self.monitor is not None:
            gauges = [*self._gauges(registry, spare, standing.disk), ("ready", "", float(not missing))]
            news = {"at": now, "gateway_at": self._gateway_at, "missing": missing, "gauges": gauges}
            self.monitor.channel.offer(news | {"totals": TALLY.values()})

    def _standing(self, now: float, *, draining: bool) -> Standing:
        spare, since = self._spare
        late = spare is not None and not spare.spoke and now - since > _SPARE_SECONDS
        return Standing(
            draining=draining,
            gateway_silent=now - self._gateway_at > self._settings.stuck_seconds,
            warm=self._warm,
            spare_silent=spare is None or late,
            disk=disk_room(self._settings.state_folder),
            reserve=self._settings.reserve_disk_bytes,
        )

    def _log_disk(self, disk: DiskRoom) -> None:
        """Once when the room gets low, once when there is enough again."""
        low = disk.free < _WARNED * self._settings.reserve_disk_bytes
        if low and not self._disk_low:
            log().warning("disk_low", free=disk.free, reserve=self._settings.reserve_disk_bytes, hint=_MAKE_ROOM)
        elif self._disk_low and not low:
            log().info("disk_has_room", free=disk.free)
        self._disk_low = low

    def _gauges(self, registry: Registry, spare: Child | None, disk: DiskRoom) -> _Gauges:
        lives = [live for live in registry.live.values() if live.status != "dead"]
        children = [live.child for live in lives] + ([spare] if spare is not None else [])
        sizes = [resident_bytes(child.pid) for child in children]
        states = Counter(live.state for live in lives)
        gauges: _Gauges = [("sessions", state, float(states[state])) for state in _STATES]
        gauges += [("worker_resident_bytes", "", float(sum(sizes)))]
        gauges += [("largest_worker_resident_bytes", "", float(max(sizes, default=0)))]
        gauges += [("disk_free_bytes", "", float(disk.free)), ("disk_size_bytes", "", float(disk.size))]
        memory = available_memory()
        return gauges if memory is None else [*gauges, ("memory_available_bytes", "", float(memory))]
