"""The list of sessions as server-sent events: one read serves all listeners; without listeners nothing is read."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import Any

from mesh_motion_server.watch.page.archive import as_json

__all__ = ["MOST_LISTENERS", "Live"]

MOST_LISTENERS = 32
_SECONDS = 1.0
#: Maximum share of the time spent on reading, because many folders take long to read.
_SHARE = 0.05
_BEAT_SECONDS = 5.0

Send = Callable[[dict[str, Any]], Awaitable[None]]


class Live:
    """The stream.

    Parameters
    ----------
    read : callable
        Awaitable that gives the data to send, without the time.
    failed : callable
        Makes the data to send from the error if reading fails.
    """

    def __init__(
        self, read: Callable[[], Awaitable[dict[str, Any]]], failed: Callable[[Exception], dict[str, Any]]
    ) -> None:
        self._read, self._failed = read, failed
        self._listeners = 0
        self._known: dict[str, Any] = {}
        self._latest = b""
        self._due = 0.0
        self._changed = asyncio.Event()
        self._over = False
        self._reading: asyncio.Task[None] | None = None

    @property
    def full(self) -> bool:
        """Whether the maximum number of listeners is reached."""
        return self._listeners >= MOST_LISTENERS

    def close(self) -> None:
        """End all streams."""
        self._over = True
        self._announce()
        if self._reading is not None:
            self._reading.cancel()

    async def stream(self, receive: Callable[[], Awaitable[Any]], send: Send) -> None:
        """Send changes until the listener disconnects or the stream closes."""
        self._listeners += 1
        if self._reading is None:
            if time.monotonic() >= self._due:  # the last data are too old to be sent first
                self._known, self._latest = {}, b""
            self._reading = asyncio.create_task(self._keep_reading())
        gone = asyncio.create_task(_gone(receive))
        try:
            await self._send_all(gone, send)
        finally:
            gone.cancel()
            self._listeners -= 1
            if not self._listeners and self._reading is not None:
                self._reading.cancel()
                self._reading = None

    async def _send_all(self, gone: asyncio.Task[None], send: Send) -> None:
        sent = b""
        await _beat(send)  # the first list may take long; the beat shows immediately that the server is alive
        while not (self._over or gone.done()):
            if self._latest and self._latest is not sent:
                sent = self._latest
                await _send_event(send, b"sessions", sent)
            else:
                await self._wait(gone)
                if self._latest is sent and not gone.done():
                    await _beat(send)

    async def _wait(self, gone: asyncio.Task[None]) -> None:
        """Wait for news, the listener's end or the next beat."""
        news = asyncio.create_task(self._changed.wait())
        await asyncio.wait({news, gone}, timeout=_BEAT_SECONDS, return_when=asyncio.FIRST_COMPLETED)
        news.cancel()

    async def _keep_reading(self) -> None:
        """Read repeatedly; the pause between reads does not depend on when listeners come and go."""
        while True:
            await asyncio.sleep(max(0.0, self._due - time.monotonic()))
            started = time.monotonic()
            try:
                found = await self._read()
                told = as_json({"at": time.time()} | found)
            # any error: otherwise the page would show an old list as live, because the stream still beats
            except Exception as error:
                found = self._failed(error)
                told = as_json({"at": time.time()} | found)
            if found != self._known:
                self._known, self._latest = found, told
                self._announce()
            ended = time.monotonic()
            self._due = max(started + _SECONDS, ended + (ended - started) / _SHARE)

    def _announce(self) -> None:
        """Wake all waiting listeners; later ones wait for the next announcement."""
        self._changed.set()
        self._changed = asyncio.Event()


async def _gone(receive: Callable[[], Awaitable[Any]]) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass


async def _beat(send: Send) -> None:
    await _send_event(send, b"beat", as_json({"at": time.time()}))


async def _send_event(send: Send, name: bytes, data: bytes) -> None:
    body = b"event: " + name + b"\ndata: " + data + b"\n\n"
    await send({"type": "http.response.body", "body": body, "more_body": True})
