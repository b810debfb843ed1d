"""A process through which people or programs observe the server: started, updated every second, restarted.

The process receives one order with the address to listen on, reports once whether it listens, and afterwards only
receives. Its failure does not affect sessions.
"""

import time
from typing import Any

from mesh_motion_server.transport.endpoints import Endpoint, EndpointError
from mesh_motion_server.transport.processes import Attempts, Child, spawn
from mesh_motion_server.transport.telemetry import log

#: A process that fails more often than this in an hour has a cause that a restart does not remove.
_STARTS = 20
#: Seconds within which the process must import its modules and bind.
_SECONDS = 60.0


class Attendant:
    """One such process.

    Parameters
    ----------
    name : str
        The setting that holds the address.
    module : str
        Run as ``python -m module CHANNEL LEVEL``.
    address : str or None
        HOST:PORT; without an address no process is started.
    order : dict
        The first message to the process; host, port, and whether only this machine reaches them (``local``) are added.
    level : str
        Log level of the process.

    Attributes
    ----------
    child : Child or None
        The process, while there is one.
    address : str
        ``tcp://HOST:PORT``, with the actual port once the process has reported; empty without a process.
    """

    def __init__(self, name: str, module: str, address: str | None, order: dict[str, Any], level: str) -> None:
        self.name = name
        self.child: Child | None = None
        self.address = f"tcp://{address}" if address else ""
        self._asked = address
        self._module = module
        self._order = order
        self._level = level
        self._attempts = Attempts(_STARTS)
        self._due = 0.0
        self._refusal = "the process ended, or did not start in time"

    def launch(self) -> bool:
        """Start the process if an address is set; return whether it was started."""
        now = time.monotonic()
        if not self.address or self._attempts.over(now):
            return False
        self._attempts.note(now)
        where = Endpoint.parse(self.address)
        child = spawn(self._module, self._level, fresh=True)
        host = "127.0.0.1" if where.host == "localhost" else where.host.strip("[]")
        child.channel.offer({"host": host, "port": where.port, "local": where.is_local} | self._order)
        self.child, self._due = child, now + _SECONDS
        return True

    def spoke(self) -> bool:
        """Read the process's report that it listens; False if it has ended instead or sent an invalid message."""
        if self.child is None:
            return False
        match self.child.channel.receive():
            case {"event": "bound", "address": str(address)}:
                self.child.spoke, self.address = True, f"tcp://{address}"
            case {"event": "unbound", "reason": str(reason)}:
                self._refusal = reason
                log().error("no_monitor", of=self.name, reason=reason)
            case _:
                return False
        return True

    def await_word(self) -> None:
        """Wait until the first process listens, if an address is set.

        Raises EndpointError if its address cannot be bound.
        """
        if self.child is None or (self.child.channel.pending(_SECONDS) and self.spoke() and self.child.spoke):
            return
        raise EndpointError(
            f"cannot listen for {self.name} on {self._asked}: {self._refusal}", hint="use another address"
        )

    def end_silent(self, now: float) -> None:
        """Kill a process that does not start to listen in time; its end is then noticed and another one is started."""
        if self.child is not None and not self.child.spoke and now >= self._due:
            log().error("no_monitor", of=self.name, reason=f"silent for {_SECONDS:.0f} s")
            self.child.kill()

    def send(self, news: dict[str, Any]) -> None:
        """Send the news of this second; if the process does not accept it, the next second sends it again."""
        if self.child is not None:
            self.child.channel.offer(news)
