"""Reports the service's status to systemd: datagrams to ``NOTIFY_SOCKET`` (sd_notify(3)), nothing without it."""

from __future__ import annotations

import os
import socket
from collections.abc import MutableMapping
from contextlib import suppress


class ServiceManager:
    """The line to the service manager.

    Parameters
    ----------
    address : str
        A path, or ``@`` and a name of the abstract namespace; empty: nothing is sent.
    """

    def __init__(self, address: str) -> None:
        self._address = "\0" + address[1:] if address.startswith("@") else address

    @classmethod
    def of_environment(cls, environment: MutableMapping[str, str] = os.environ) -> ServiceManager:
        """Return the manager that started this process; children do not inherit the address."""
        environment.pop("WATCHDOG_PID", None)
        environment.pop("WATCHDOG_USEC", None)
        return cls(environment.pop("NOTIFY_SOCKET", ""))

    def notify(self, *states: str) -> None:
        """Send assignments such as ``READY=1``; errors of a manager that does not listen are ignored."""
        if not self._address:
            return
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as line:
            line.setblocking(False)
            line.sendto("\n".join(states).encode(), self._address)
