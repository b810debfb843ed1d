"""The process of the page: ``python -m mesh_motion_server.watch.page.process CHANNEL LEVEL``.

The supervisor starts it, and it ends with the supervisor. Every second the supervisor reports which sessions have a
worker; the process reads everything else from their folders. It has the lowest priority, and limits on memory and
descriptors.
"""

import asyncio
import ipaddress
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import uvicorn

from mesh_motion_server.transport.channel import Channel
from mesh_motion_server.transport.processes import limit_address_space, limit_descriptors, offer_to_the_oom_killer
from mesh_motion_server.transport.telemetry import configure, log, log_suppressed
from mesh_motion_server.watch.page.app import Page
from mesh_motion_server.watch.page.connections import BoundedProtocol

#: Memory beyond what Python maps: libraries, threads, one mesh.
_MEMORY = 3 << 30
#: More than the connections that connections.py admits, for the files of histories and meshes too.
_DESCRIPTORS = 256
_BACKLOG = 64
#: Largest head of a request: the page sends only GET with short parameters.
_REQUEST_BYTES = 16384
#: Niceness: gives a tenth of a processor when solvers use all of them; 19 gave a hundredth, and a page took minutes to
#: open.
_NICENESS = 10


class _Server(uvicorn.Server):
    """A server that leaves signals to the supervisor."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Do not change the signal handlers."""
        yield


def _yield_the_processor() -> None:
    """Lower the priority of this process below the solvers."""
    with suppress(OSError):
        os.nice(_NICENESS)


def _listening(host: str, port: int) -> socket.socket:
    """A bound socket."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    return socket.create_server((host, port), family=family, backlog=_BACKLOG)


def _config(page: Page) -> uvicorn.Config:
    return uvicorn.Config(
        page.app,
        http=BoundedProtocol,
        ws="none",
        lifespan="off",
        log_config=None,
        log_level="warning",
        date_header=False,
        access_log=False,
        proxy_headers=False,
        server_header=False,
        backlog=_BACKLOG,
        timeout_keep_alive=10,
        timeout_graceful_shutdown=1,
        h11_max_incomplete_event_size=_REQUEST_BYTES,
    )


async def _serve(channel: Channel, order: dict[str, Any]) -> int:
    """Listen until the supervisor closes the channel."""
    try:
        listening = _listening(order["host"], order["port"])
    except OSError as error:
        channel.send({"event": "unbound", "reason": error.strerror or str(error)})
        return 1
    host, port = listening.getsockname()[:2]
    page = Page(Path(order["state"]), order["build"], insecure=not ipaddress.ip_address(host).is_loopback)
    server = _Server(_config(page))
    channel.send({"event": "bound", "address": f"[{host}]:{port}" if ":" in host else f"{host}:{port}"})

    def receive() -> None:
        news = channel.receive()
        if news is not None:
            page.update(news)
            log_suppressed()
            return
        asyncio.get_running_loop().remove_reader(channel.fileno())
        server.should_exit = True

    asyncio.get_running_loop().add_reader(channel.fileno(), receive)
    await server.serve(sockets=[listening])
    return 0


def main(channel: Channel, level: str) -> int:
    """Wait for the order, then serve."""
    configure("page", level)
    order = channel.receive()
    if order is None:
        return 0
    _yield_the_processor()
    offer_to_the_oom_killer()
    limit_descriptors(_DESCRIPTORS)
    limit_address_space(_MEMORY)
    status = asyncio.run(_serve(channel, order))
    log().debug("page_ended", status=status)
    # threads that are still reading must not delay the end of the server
    os._exit(status)


if __name__ == "__main__":
    sys.exit(main(Channel.inherited(int(sys.argv[1])), sys.argv[2]))
