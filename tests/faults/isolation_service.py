"""The stand-in's service for bad neighbours: sessions that crash when they are asked how they are, and a large reply.

Labels ask for trouble in STATUS: ``kill`` ends the process at once, ``abort`` as a failed assertion in native code
does, ``memory`` takes memory until the worker's limit. FETCH is answered by 100 MB, whatever the mesh is.
"""

import os
import signal

import numpy as np
from mesh_motion_protocol.messages import Fetch, Fetched, Status

from mesh_motion_server.service.envelope import Envelope
from mesh_motion_server.transport import template
from mesh_motion_server.transport.channel import Channel
from tests.faults.stand_in_service import SessionHost as StandInHost
from tests.faults.stand_in_service import SessionStore

__all__ = ["LARGE_ROWS", "SessionHost", "SessionStore", "main"]

#: Rows of three numbers, 8 bytes each, that make 100 MB.
LARGE_ROWS = 100_000_000 // 24
_BLOCK = 64 << 20
_ENDS = {"kill": signal.SIGKILL, "abort": signal.SIGABRT}


class SessionHost(StandInHost):
    """The stand-in's, with bad manners."""

    def handle(self, envelope: Envelope) -> list[Envelope]:
        """As the real one, but for STATUS and FETCH."""
        request = envelope.message
        if isinstance(request, Fetch):
            points = np.zeros((LARGE_ROWS, 3))
            return [
                Envelope(
                    envelope.peer, Fetched(client=request.client, sequence=request.sequence, step=0, points=points)
                )
            ]
        if isinstance(request, Status) and self.label in _ENDS:
            os.kill(os.getpid(), _ENDS[self.label])
        if isinstance(request, Status) and self.label == "memory":
            return self._answered(envelope, _take_memory)
        return super().handle(envelope)


def _take_memory(_: Envelope) -> list[Envelope]:
    """Until there is none."""
    taken = []
    while True:
        taken.append(np.ones(_BLOCK, dtype=np.uint8))


def main(channel: Channel, level: str) -> int:
    """What the template runs."""
    return template.main(channel, level, lambda: (SessionHost, SessionStore))
