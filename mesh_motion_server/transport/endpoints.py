"""Endpoints: allowed addresses, the folder and lock of an ipc endpoint, sockets with all limits set."""

from __future__ import annotations

import fcntl
import ipaddress
import os
import re
import socket
import stat
import struct
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TextIO

import zmq
from mesh_motion_protocol.errors import MeshMotionError
from mesh_motion_protocol.ipc_paths import PATH_BYTES

#: Longest name of a worker's socket in the folder of a control endpoint.
_WORKER_NAME = "/w4194304.ipc"
_WORKER_FILES = "w[0-9]*.ipc"


class EndpointError(MeshMotionError):
    """The server cannot listen on an endpoint: it is wrong, unsafe or in use."""

    default_code = "INVALID_ARGUMENT"


@dataclass(frozen=True)
class Endpoint:
    """The address of the control endpoint."""

    scheme: str  # {"tcp", "ipc"}
    host: str = ""  # tcp: the address; empty for ipc
    port: int = 0  # tcp: 0 lets the system choose
    path: str = ""  # ipc: the socket's file

    @classmethod
    def parse(cls, text: str) -> Endpoint:
        """Read ``tcp://HOST:PORT`` or ``ipc://PATH``.

        Raises EndpointError if it is neither, the port is invalid, or the path is too long for the kernel.
        """
        scheme, separator, rest = text.partition("://")
        if separator and scheme == "tcp":
            host, _, port = rest.rpartition(":")
            if host and re.fullmatch("[0-9]{1,5}", port) and int(port) <= 65535:
                return cls("tcp", host=host, port=int(port))
        if separator and scheme == "ipc" and rest.startswith("/"):
            return cls("ipc", path=_short_enough(rest))
        raise EndpointError(
            f"endpoint must be tcp://HOST:PORT or ipc:///absolute/path, got {text!r}",
            hint="tcp://127.0.0.1:0 lets the system choose a free port",
        )

    @property
    def is_local(self) -> bool:
        """Whether the endpoint is reachable from this machine only."""
        if self.scheme == "ipc" or self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host.strip("[]")).is_loopback
        except ValueError:
            return False

    @property
    def address(self) -> str:
        """The address to bind a socket to."""
        if self.scheme == "ipc":
            return f"ipc://{self.path}"
        host = "127.0.0.1" if self.host == "localhost" else self.host
        return f"tcp://{host}:{self.port or '*'}"

    @property
    def worker_address(self) -> str:
        """The address for the data socket of this process: a free port, or a file named after the process."""
        if self.scheme == "ipc":
            return f"ipc://{Path(self.path).parent}/w{os.getpid()}.ipc"
        return Endpoint("tcp", host=self.host).address

    def worker_addresses(self, ports: str | None) -> list[str]:
        """Addresses to try for the data socket of this process: the ports of a range ("7441-7504") in order."""
        if ports is None or self.scheme == "ipc":
            return [self.worker_address]
        first, last = (int(port) for port in ports.split("-"))
        return [replace(self, port=port).address for port in range(first, last + 1)]

    def advertised_as(self, host: str | None) -> str:
        """Return this endpoint as clients see it, with another host if one is given."""
        return self.address if host is None or self.scheme == "ipc" else replace(self, host=host).address


def _short_enough(path: str) -> str:
    longest = max(len(os.fsencode(path)), len(os.fsencode(str(Path(path).parent) + _WORKER_NAME)))
    if longest > PATH_BYTES:
        raise EndpointError(
            f"an ipc path and its data sockets must fit into {PATH_BYTES} bytes, {path!r} is too long",
            hint="use a shorter folder, for example under /tmp or /run",
        )
    return path


def lock_folder(endpoint: Endpoint) -> TextIO | None:
    """Make an ipc endpoint's folder private and take its lock: binding over a live server would steal its endpoint.

    Raises EndpointError if other users may enter the folder, or a live server holds the lock.

    Returns
    -------
    file or None
        Keep it open as long as the endpoint is in use; None for tcp.
    """
    if endpoint.scheme != "ipc":
        return None
    folder = Path(endpoint.path).parent
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    status = folder.stat()
    if status.st_uid != os.geteuid() or stat.S_IMODE(status.st_mode) & 0o077:
        raise EndpointError(
            f"the folder {folder} of an ipc endpoint must belong to you alone (mode 0700), "
            f"got mode {stat.S_IMODE(status.st_mode):04o}",
            hint="chmod 700 it, or use a folder of its own",
        )
    lock = open(f"{endpoint.path}.lock", "w", encoding="utf-8")  # noqa: SIM115 - held for the server's life
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        lock.close()
        raise EndpointError(
            f"a live server listens on {endpoint.address}", hint="stop it first, or use another path"
        ) from None
    for left in filter(Path.is_socket, folder.glob(_WORKER_FILES)):
        _remove_without_listener(left)
    return lock


def _remove_without_listener(file: Path) -> None:
    """Remove the socket's file of a worker that was killed with its server; another server's worker still listens."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK) as line:
        try:
            line.connect(str(file))
        except ConnectionRefusedError:
            file.unlink(missing_ok=True)
        except OSError:
            pass  # for example a busy worker


def bind(socket: zmq.Socket[bytes], address: str) -> str:
    """Bind; return the address with the port that the system chose."""
    socket.setsockopt(zmq.IPV6, int("[" in address))
    socket.bind(address)
    where = socket.getsockopt(zmq.LAST_ENDPOINT)
    return where.rstrip(b"\0").decode() if isinstance(where, bytes) else address


def bind_first(socket: zmq.Socket[bytes], addresses: Iterable[str]) -> str:
    """Bind to the first free address. Raises EndpointError if none is free."""
    busy = []
    for address in addresses:
        try:
            return bind(socket, address)
        except zmq.ZMQError as error:
            if error.errno != zmq.EADDRINUSE:
                raise
            busy.append(address)
    raise EndpointError(
        f"no data port is free: {busy[0]} to {busy[-1]} are taken" if busy else "data_ports is an empty range",
        code="RESOURCE_EXHAUSTED.SESSIONS",
        hint="close a session, or give data_ports more ports than max_sessions",
    )


def router(
    context: zmq.Context[zmq.Socket[bytes]], *, message_bytes: int, queued: int, handshake_seconds: float
) -> zmq.Socket[bytes]:
    """Return a ROUTER socket with all limits set.

    Parameters
    ----------
    message_bytes : int
        Largest frame; a peer that announces a larger one is disconnected before memory is allocated.
    queued : int
        Messages queued per peer and direction.
    handshake_seconds : float
        A connection that has not finished its handshake by then is closed.
    """
    socket = context.socket(zmq.ROUTER)
    socket.setsockopt(zmq.MAXMSGSIZE, message_bytes)
    socket.setsockopt(zmq.RCVHWM, queued)
    socket.setsockopt(zmq.SNDHWM, queued)
    # a second connection cannot take over the routing id of another one, and with it the replies
    socket.setsockopt(zmq.ROUTER_HANDOVER, 0)
    socket.setsockopt(zmq.ROUTER_MANDATORY, 1)
    socket.setsockopt(zmq.HANDSHAKE_IVL, max(1, round(1000 * handshake_seconds)))
    # a peer that disappeared without a word is disconnected, so that it does not keep a session's lease for ever
    socket.setsockopt(zmq.HEARTBEAT_IVL, 10_000)
    socket.setsockopt(zmq.HEARTBEAT_TIMEOUT, 30_000)
    socket.setsockopt(zmq.LINGER, 5_000)  # an ending process still sends its last replies
    return socket


def connection_event(monitor: zmq.Socket[bytes]) -> tuple[int, int]:
    """Return the next event of a socket's monitor and its value; ``zmq.utils.monitor`` would import asyncio."""
    event, value = struct.unpack("=Hi", monitor.recv_multipart()[0])
    return event, value
