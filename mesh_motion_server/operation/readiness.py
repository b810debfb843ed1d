"""The condition that prevents a server from taking new sessions: one line, empty if there is none."""

from __future__ import annotations

from dataclasses import dataclass

from mesh_motion_server.operation.disk_watch import SILENT_SECONDS
from mesh_motion_server.operation.room import DiskRoom


@dataclass(frozen=True)
class Readiness:
    """The conditions of readiness."""

    draining: bool
    gateway_silent: bool  # the gateway has not answered for ``stuck_seconds``
    warm: bool  # a template has completed its imports since the server started
    template_silent: bool  # there is no template to fork workers from, or it has not become ready for too long
    disk: DiskRoom
    disk_silence: float  # seconds for which the disk has not answered
    reserve: int  # bytes of the disk that are reserved for the running sessions

    def missing(self) -> str:
        """Return the first missing condition, in one line."""
        room = f"disk: {self.disk.free} bytes are free, {self.reserve} are kept for running sessions"
        lacks = (
            (self.draining, "draining: the server is stopping"),
            (self.gateway_silent, "gateway: it does not answer"),
            (not self.warm, "kernels: they are not loaded yet"),
            (self.template_silent, "template: the process that workers are forked from does not become ready"),
            (self.disk_silence > SILENT_SECONDS, f"disk: it has not answered for {self.disk_silence:.0f} s"),
            (not self.disk.writable, "disk: the state folder cannot be written"),
            (self.disk.free < self.reserve, room),
        )
        return next((text for lacking, text in lacks if lacking), "")
