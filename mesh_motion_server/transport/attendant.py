"""A process beside the server that people or programs look at it through: started, told every second, started again.

It gets an order with where to listen, says once whether it does, and from then on only hears. Whatever becomes of it,
sessions go on.
"""

from __future__ import annotations

import time
from typing import Any

from mesh_motion_server.transport.endpoints import Endpoint, EndpointError
from mesh_motion_server.transport.processes import Attempts, Child, spawn
from mesh_motion_server.transport.telemetry import log

__all__ = ["Attendant"]

#: One that falls more often in an hour has a reason that restarting does not cure.
_STARTS = 20
#: It imports and binds within this, seconds.
_SECONDS = 60.0


class Attendant:
    """One such process.

    Parameters
    ----------
    name : str
        What it offers: the setting with its address.
    module : str
        Run as ``python -m module CHANNEL LEVEL``.
    address : str, optional
        HOST:PORT; without it there is no process.
    order : dict
        What it is told at first, beside host and port.
    level : str
        Log level, handed to it.

    Attributes
    ----------
    child : Child or None
        The process, while there is one.
    address : str
        ``tcp://HOST:PORT``, from its first word on with the port that it listens on; empty without a process.
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
        """Start it, where there shall be one; whether it was started."""
        now = time.monotonic()
        if not self.address or self._attempts.over(now):
            return False
        self._attempts.note(now)
        where = Endpoint.parse(self.address)
        child = spawn(self._module, self._level, anew=True)
        host = "127.0.0.1" if where.host == "localhost" else where.host.strip("[]")
        child.channel.offer({"host": host, "port": where.port} | self._order)
        self.child, self._due = child, now + _SECONDS
        return True

    def spoke(self) -> bool:
        """Hear its one word, whether it listens; False when it has ended instead, or says what nobody understands."""
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
        """Return when the first one listens, if there shall be one.

        Raises
        ------
        EndpointError
            If its address cannot be bound.
        """
        if self.child is None or (self.child.channel.pending(_SECONDS) and self.spoke() and self.child.spoke):
            return
        raise EndpointError(
            f"cannot listen for {self.name} on {self._asked}: {self._refusal}", hint="use another address"
        )

    def end_silent(self, now: float) -> None:
        """Kill one that does not come to listen; its end is heard, and another one started."""
        if self.child is not None and not self.child.spoke and now >= self._due:
            log().error("no_monitor", of=self.name, reason=f"silent for {_SECONDS:.0f} s")
            self.child.kill()

    def tell(self, news: dict[str, Any]) -> None:
        """This second's news; what it does not take is told again in the next."""
        if self.child is not None:
            self.child.channel.offer(news)
