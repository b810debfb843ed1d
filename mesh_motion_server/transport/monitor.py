"""``/metrics``, ``/healthz`` and ``/readyz`` over HTTP, in a separate process.

``python -m mesh_motion_server.transport.monitor CHANNEL LEVEL``. It knows only the message that the supervisor sends
every second: totals, and which parts are missing. So slow scrapers, port scans or a flood of connections load this
process alone, and it has no secrets. When the supervisor's messages stop, ``/healthz`` reports it: this process does
not depend on the loop that it watches.

Each connection has one request and five seconds in total; when there are too many, the oldest one is closed.
"""

import asyncio
import contextlib
import sys
import time
from typing import Any

from mesh_motion_server.operation.exposition import CONTENT_TYPE, exposition
from mesh_motion_server.security.host_header import is_allowed_host
from mesh_motion_server.transport.channel import Channel
from mesh_motion_server.transport.processes import limit_address_space, limit_descriptors
from mesh_motion_server.transport.telemetry import configure, log

#: Bytes beyond what Python maps.
_MEMORY = 256 << 20
#: More than the connections below and the process' own files, so accepting a connection does not fail.
_DESCRIPTORS = 256
#: Largest number of connections at a time; a new one closes the oldest.
_CONNECTIONS = 64
#: Longest time for a request and its answer (docs/security.md).
_SECONDS = 5.0
#: Longest request with its headers.
_REQUEST_BYTES = 8192
_TEXT = "text/plain; charset=utf-8"
_REASONS = {
    200: "OK",
    400: "Bad Request",
    404: "Not Found",
    405: "Method Not Allowed",
    421: "Misdirected Request",
    503: "Service Unavailable",
}

_Answer = tuple[int, str, bytes]


class Pages:
    """The pages, made from the supervisor's last message.

    Parameters
    ----------
    build : dict
        Versions.
    stuck_seconds : float
        Silence of a loop after which it counts as stuck.
    local : bool
        Whether only this machine reaches the pages: they are then read under its own addresses and ``localhost`` alone.
    """

    def __init__(self, build: dict[str, str], stuck_seconds: float, *, local: bool = False) -> None:
        self._build = build
        self._stuck_seconds = stuck_seconds
        self.local = local
        self._news: dict[str, Any] = {"at": time.monotonic(), "gateway_at": time.monotonic(), "missing": "starting"}
        self._metrics: dict[bool, bytes] = {}

    def update(self, news: dict[str, Any]) -> None:
        """Take the supervisor's message of this second."""
        self._news, self._metrics = news, {}

    def answer(self, path: str) -> _Answer:
        """Return status, content type and body of a page."""
        if path == "/metrics":
            return 200, CONTENT_TYPE, self._page()
        if path not in ("/healthz", "/readyz"):
            return 404, _TEXT, b"there are /metrics, /healthz and /readyz\n"
        wrong = self._stuck() or (self._news["missing"] if path == "/readyz" else "")
        return (503 if wrong else 200), _TEXT, f"{wrong or 'ok'}\n".encode()

    def _stuck(self) -> str:
        sent_at = self._news["at"]
        silences = {"supervisor": time.monotonic() - sent_at, "gateway": sent_at - self._news["gateway_at"]}
        for name, silence in silences.items():
            if silence > self._stuck_seconds:
                return f"{name}: silent for {silence:.0f} s"
        return ""

    def _page(self) -> bytes:
        """Make the page once for each message; a stuck server is not ready, whatever the message says."""
        stuck = bool(self._stuck())
        if stuck not in self._metrics:
            totals = self._news.get("totals", {"counts": [], "spreads": {}})
            ready = [("ready", "", 0.0)] if stuck else []
            self._metrics[stuck] = exposition(totals, [*self._news.get("gauges", ()), *ready], self._build)
        return self._metrics[stuck]


class _Listener:
    """Accepts the connections."""

    def __init__(self, pages: Pages) -> None:
        self._pages = pages
        self._open: dict[asyncio.Task[Any], None] = {}

    async def connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Handle one connection: one request, one answer."""
        task = asyncio.current_task()
        if task is None:
            return
        self._open[task] = None
        if len(self._open) > _CONNECTIONS:
            oldest = next(iter(self._open))
            del self._open[oldest]
            oldest.cancel()
        try:
            with contextlib.suppress(OSError, asyncio.IncompleteReadError, asyncio.CancelledError, TimeoutError):
                async with asyncio.timeout(_SECONDS):
                    await self._converse(reader, writer)
        finally:
            self._open.pop(task, None)
            writer.transport.abort() if writer.transport.get_write_buffer_size() else writer.close()

    async def _converse(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            request = await reader.readuntil(b"\r\n\r\n")
        except asyncio.LimitOverrunError:
            request = b""
        writer.write(_response(self._pages, request))
        await writer.drain()
        if writer.can_write_eof():
            writer.write_eof()
        while await reader.read(_REQUEST_BYTES):
            pass  # closing with unread data would discard the answer; the client closes when it has the answer


def _response(pages: Pages, request: bytes) -> bytes:
    """Return the bytes that answer a request."""
    words = request.partition(b"\r\n")[0].decode("latin-1").split(" ")
    if len(words) != 3 or not words[2].startswith("HTTP/1."):
        status, kind, body = 400, _TEXT, b"expected an HTTP/1 request\n"
    elif words[0] not in ("GET", "HEAD"):
        status, kind, body = 405, _TEXT, b"expected GET\n"
    elif pages.local and not all(is_allowed_host(host, insecure=False) for host in _hosts(request)):
        status, kind, body = 421, _TEXT, b"expected this machine's address or localhost as the host\n"
    else:
        status, kind, body = pages.answer(words[1].partition("?")[0])
    head = (
        f"HTTP/1.1 {status} {_REASONS[status]}\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\n"
        "Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n"
    )
    return head.encode() + (b"" if words[0] == "HEAD" else body)


def _hosts(request: bytes) -> list[str]:
    """Return the Host headers. Browsers always send one; probes with HTTP/1.0 may not."""
    headers = (line.partition(b":") for line in request.split(b"\r\n")[1:])
    return [value.strip().decode("latin-1") for name, _, value in headers if name.strip().lower() == b"host"]


async def _serve(channel: Channel, order: dict[str, Any]) -> int:
    """Listen until the supervisor closes the channel."""
    pages = Pages(order["build"], order["stuck_seconds"], local=order["local"])
    listener = _Listener(pages)
    try:
        server = await asyncio.start_server(
            listener.connected, order["host"], order["port"], limit=_REQUEST_BYTES, backlog=_CONNECTIONS
        )
    except OSError as error:
        channel.send({"event": "unbound", "reason": error.strerror or str(error)})
        return 1
    host, port = server.sockets[0].getsockname()[:2]
    channel.send({"event": "bound", "address": f"[{host}]:{port}" if ":" in host else f"{host}:{port}"})
    over = asyncio.Event()

    def receive() -> None:
        news = channel.receive()
        if news is None:
            over.set()
        else:
            pages.update(news)

    loop = asyncio.get_running_loop()
    loop.add_reader(channel.fileno(), receive)
    await over.wait()
    loop.remove_reader(channel.fileno())
    server.close()
    return 0


def main(channel: Channel, level: str) -> int:
    """Wait for the order, then serve."""
    configure("monitor", level)
    order = channel.receive()
    if order is None:
        return 0
    limit_descriptors(_DESCRIPTORS)
    limit_address_space(_MEMORY)
    status = asyncio.run(_serve(channel, order))
    log().debug("monitor_ended", status=status)
    return status


if __name__ == "__main__":
    sys.exit(main(Channel.inherited(int(sys.argv[1])), sys.argv[2]))
