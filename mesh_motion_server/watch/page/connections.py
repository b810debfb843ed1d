"""Connections with a bound on everything: how many, how long a request may take to come, how long an answer to go.

uvicorn waits for ever for a request's first lines and for a reader that does not read. Here a connection has
:data:`REQUEST_SECONDS` for each request, an answer that nobody takes is dropped after :data:`ANSWER_SECONDS`, and of
more than :data:`MOST` connections an idle one is closed, or the oldest.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

__all__ = ["ANSWER_SECONDS", "MOST", "REQUEST_SECONDS", "BoundedProtocol"]

MOST = 96
REQUEST_SECONDS = 5.0
ANSWER_SECONDS = 20.0


class BoundedProtocol(H11Protocol):
    """One connection."""

    _request_timer: asyncio.TimerHandle | None = None
    _answer_timer: asyncio.TimerHandle | None = None

    @property
    def answering(self) -> bool:
        """Whether a request is being answered."""
        return self.cycle is not None and not self.cycle.response_complete

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Make room, and start to wait for the request."""
        # many are accepted in one turn of the loop: what was ended in it is still listed, and makes no room twice
        known: list[Any] = [each for each in self.connections if isinstance(each, BoundedProtocol)]
        others = [each for each in known if not each.transport.is_closing()]
        super().connection_made(transport)
        self.made_at = self.loop.time()
        if len(others) >= MOST:
            _victim(others).abort()
        self._await_request()

    def data_received(self, data: bytes) -> None:
        """Part of a request; once it is whole, nothing more is waited for."""
        if self._request_timer is None and not self.answering:
            self._await_request()
        super().data_received(data)
        if self.answering:
            _cancel(self._request_timer)
            self._request_timer = None

    def on_response_complete(self) -> None:
        """The time for an idle connection is uvicorn's from here on, that for the next request ours."""
        _cancel(self._request_timer)
        self._request_timer = None
        super().on_response_complete()

    def pause_writing(self) -> None:
        """The reader is behind."""
        super().pause_writing()
        _cancel(self._answer_timer)
        self._answer_timer = None
        self._answer_timer = self.loop.call_later(ANSWER_SECONDS, self.abort)

    def resume_writing(self) -> None:
        """It has caught up."""
        _cancel(self._answer_timer)
        self._answer_timer = None
        super().resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the timers."""
        _cancel(self._request_timer)
        self._request_timer = None
        _cancel(self._answer_timer)
        self._answer_timer = None
        super().connection_lost(exc)

    def abort(self) -> None:
        """End it at once."""
        self.transport.abort()

    def _await_request(self) -> None:
        self._request_timer = self.loop.call_later(REQUEST_SECONDS, self.abort)


def _victim(connections: Iterable[Any]) -> Any:
    """An idle connection, else the oldest."""
    return min(connections, key=lambda each: (each.answering, each.made_at))


def _cancel(timer: asyncio.TimerHandle | None) -> None:
    if timer is not None:
        timer.cancel()
