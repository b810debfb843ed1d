"""The list of sessions as server-sent events: one reading for all who look, none while nobody does."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import Any

from mesh_motion_server.watch.page.archive import as_json

__all__ = ["MOST_LISTENERS", "Live"]

MOST_LISTENERS = 32
_SECONDS = 1.0
#: And no more of the time than this: reading many folders takes its time.
_SHARE = 0.05
_BEAT_SECONDS = 5.0

Send = Callable[[dict[str, Any]], Awaitable[None]]


class Live:
    """The stream.

    Parameters
    ----------
    read : callable
        Awaitable with what is sent, without the time.
    failed : callable
        What is sent instead where reading fails, from the error.
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
        """Whether nobody else may listen."""
        return self._listeners >= MOST_LISTENERS

    def close(self) -> None:
        """Let all streams end."""
        self._over = True
        self._announce()
        if self._reading is not None:
            self._reading.cancel()

    async def stream(self, receive: Callable[[], Awaitable[Any]], send: Send) -> None:
        """Send what changes until the listener goes or all is over."""
        self._listeners += 1
        if self._reading is None:
            if time.monotonic() >= self._due:  # what was read last is too old to be shown first
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
        await _beat(send)  # the first list may take long; that there is a server is told at once
        while not (self._over or gone.done()):
            if self._latest and self._latest is not sent:
                sent = self._latest
                await _send_event(send, b"sessions", sent)
            else:
                await self._wait(gone)
                if self._latest is sent and not gone.done():
                    await _beat(send)

    async def _wait(self, gone: asyncio.Task[None]) -> None:
        """For news, the listener's end or the next beat."""
        news = asyncio.create_task(self._changed.wait())
        await asyncio.wait({news, gone}, timeout=_BEAT_SECONDS, return_when=asyncio.FIRST_COMPLETED)
        news.cancel()

    async def _keep_reading(self) -> None:
        """Read again and again; the pause holds over listeners, who come and go as they like."""
        while True:
            await asyncio.sleep(max(0.0, self._due - time.monotonic()))
            started = time.monotonic()
            try:
                found = await self._read()
                told = as_json({"at": time.time()} | found)
            # whatever it is: a page whose list stands still beside a beating stream would call itself live
            except Exception as error:
                found = self._failed(error)
                told = as_json({"at": time.time()} | found)
            if found != self._known:
                self._known, self._latest = found, told
                self._announce()
            ended = time.monotonic()
            self._due = max(started + _SECONDS, ended + (ended - started) / _SHARE)

    def _announce(self) -> None:
        """Wake all who wait; who comes later waits for the next."""
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
