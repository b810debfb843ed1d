"""The checks of every second: children, disk, memory; and the reports to attendants, systemd and the log.

The supervisor's loop calls :meth:`Watch.beat`, so each report also shows that the loop runs.
"""

import platform
import time
from collections import Counter

from mesh_motion_protocol import PROTOCOL_VERSION

from mesh_motion_server import __version__
from mesh_motion_server.operation.disk_watch import SILENT_SECONDS, DiskWatch
from mesh_motion_server.operation.readiness import Readiness
from mesh_motion_server.operation.room import DiskRoom, available_memory, resident_bytes
from mesh_motion_server.operation.service_manager import ServiceManager
from mesh_motion_server.operation.tally import TALLY
from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.attendant import Attendant
from mesh_motion_server.transport.gateway_line import GatewayLine
from mesh_motion_server.transport.processes import Child
from mesh_motion_server.transport.registry import Live, Registry
from mesh_motion_server.transport.telemetry import log, log_suppressed

#: Time between two beats: checks of all processes, and reports to the attendants.
_SECONDS = 1.0
#: Limit for the template's imports, which take one second on an idle machine.
_TEMPLATE_SECONDS = 60.0
#: The log warns when less than this many times the reserve is left.
_WARNED = 2
#: Largest number of sessions sent to the page, the latest ones; their entries fit into one message.
_MOST_SESSIONS = 500
_MAKE_ROOM = "make room, for example remove history/ of closed sessions: below the reserve new sessions are refused"
#: States of a session with a worker.
_STATES = ("NEW", "OPENING", "READY", "TRIAL", "COMMITTING", "SUSPENDED", "FROZEN", "FAILED")

_Gauges = list[tuple[str, str, float]]


class Watch:
    """Checks and reports the state of the server.

    Parameters
    ----------
    level : str
        Log level, handed to the attendants.
    disk : DiskWatch
        The disk of the state folder.

    Attributes
    ----------
    metrics, page : Attendant
        The process for Prometheus and probes, and the process for the page.
    """

    def __init__(self, settings: ServerSettings, level: str, manager: ServiceManager, disk: DiskWatch) -> None:
        self.manager = manager
        self.metrics = Attendant(
            "metrics",
            "mesh_motion_server.transport.monitor",
            settings.metrics,
            {"build": _build(), "stuck_seconds": settings.stuck_seconds},
            level,
        )
        self.page = Attendant(
            "monitor",
            "mesh_motion_server.watch.page.process",
            settings.monitor,
            {"build": _build(), "state": str(settings.state_folder)},
            level,
        )
        self.next_beat = time.monotonic() + _SECONDS
        self._disk = disk
        self._settings = settings
        self._warm = False
        self._template: tuple[Child | None, float] = (None, time.monotonic())
        self._disk_trouble = ""

    @property
    def attendants(self) -> tuple[Attendant, ...]:
        """Return all attendants, also those that are not configured."""
        return self.metrics, self.page

    # --- what happens ------------------------------------------------------------------------------------------------

    def worker_started(self) -> None:
        """Count a started worker of a session."""
        TALLY.count("worker_starts")

    def worker_ended(self, code: int) -> None:
        """Count an ended worker with its exit status, negative after a signal."""
        TALLY.count("worker_ends", label="orderly" if code == 0 else "signal" if code < 0 else "failure")

    # --- every second ------------------------------------------------------------------------------------------------

    def beat(self, registry: Registry, gateway: GatewayLine, template: Child | None, *, draining: bool) -> None:
        """Check and report."""
        now = time.monotonic()
        self.next_beat = now + _SECONDS
        log_suppressed()
        gateway.ask(now, self._settings.stuck_seconds)
        for attendant in self.attendants:
            attendant.end_silent(now)
        if template is not self._template[0]:
            self._template = (template, now)
        self._warm = self._warm or (template is not None and template.spoke)
        readiness = self._readiness(now, now - gateway.answered_at, draining=draining)
        self._log_disk(readiness)
        missing = readiness.missing()
        if not readiness.gateway_silent:
            self.manager.notify("WATCHDOG=1", f"STATUS={len(registry.working())} sessions{missing and '; ' + missing}")
        if self.metrics.child is not None:
            gauges = [*self._gauges(registry, template, readiness.disk), ("ready", "", float(not missing))]
            news = {"at": now, "gateway_at": gateway.answered_at, "missing": missing, "gauges": gauges}
            self.metrics.send(news | {"totals": TALLY.values()})
        if self.page.child is not None:
            sessions = [[*_entry(live)] for live in registry.live.values()]
            # the latest ones; failed ones only if there is room after the working ones
            sessions = sorted(sessions, key=lambda entry: entry[1] != "dead")[-_MOST_SESSIONS:]
            self.page.send({"missing": missing, "sessions": sessions})
        self._disk.ask()  # base for the next time

    def _readiness(self, now: float, silence: float, *, draining: bool) -> Readiness:
        template, since = self._template
        late = template is not None and not template.spoke and now - since > _TEMPLATE_SECONDS
        return Readiness(
            draining=draining,
            gateway_silent=silence > self._settings.stuck_seconds,
            warm=self._warm,
            template_silent=template is None or late,
            disk=self._disk.room,
            disk_silence=self._disk.silence(),
            reserve=self._settings.reserve_disk_bytes,
        )

    def _log_disk(self, readiness: Readiness) -> None:
        """Log once when the disk gets full or silent, and once when it is usable again."""
        disk, reserve = readiness.disk, self._settings.reserve_disk_bytes
        trouble = ""
        if readiness.disk_silence > SILENT_SECONDS:
            trouble = "disk_silent"
        elif disk.free < _WARNED * reserve:
            trouble = "disk_low"
        if trouble == self._disk_trouble:
            return
        self._disk_trouble = trouble
        if trouble == "disk_silent":
            log().error(trouble, hint="check the disk or network mount of the state folder")
        elif trouble:
            log().warning(trouble, free=disk.free, reserve=reserve, hint=_MAKE_ROOM)
        else:
            log().info("disk_has_room", free=disk.free)

    def _gauges(self, registry: Registry, template: Child | None, disk: DiskRoom) -> _Gauges:
        lives = [live for live in registry.live.values() if live.status != "dead"]
        children = [live.child for live in lives] + ([template] if template is not None else [])
        sizes = [resident_bytes(child.pid) for child in children]
        states = Counter(live.state for live in lives)
        gauges: _Gauges = [("sessions", state, float(states[state])) for state in _STATES]
        gauges += [("worker_resident_bytes", "", float(sum(sizes)))]
        gauges += [("largest_worker_resident_bytes", "", float(max(sizes, default=0)))]
        gauges += [("disk_free_bytes", "", float(disk.free)), ("disk_size_bytes", "", float(disk.size))]
        gauges += [("disk_silence_seconds", "", self._disk.silence())]
        memory = available_memory()
        return gauges if memory is None else [*gauges, ("memory_available_bytes", "", float(memory))]


def _build() -> dict[str, str]:
    """Return the versions of the software."""
    version = ".".join(map(str, PROTOCOL_VERSION))
    return {"version": __version__, "protocol": version, "python": platform.python_version()}


def _entry(live: Live) -> tuple[str, str, str, int, int]:
    """Return the values of a session that has or had a worker: no token, no owner, no label."""
    return live.session, live.status, live.state, live.step, live.epoch
