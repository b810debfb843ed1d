"""An ended process from its parent's view."""

from mesh_motion_server.transport.channel import Channel
from mesh_motion_server.transport.processes import Child


class EndedChild(Child):
    def __init__(self, channel: Channel) -> None:
        super().__init__(2**22, channel)
        self.killed = 0

    def kill(self) -> None:
        self.killed += 1

    def _status(self) -> int | None:
        return 0
