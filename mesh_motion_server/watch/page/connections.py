"""Connections with limits: their number, the time to receive a request, and the time to send an answer.

uvicorn waits without limit for a request's first lines and for a client that does not read. Here a connection has
:data:`REQUEST_SECONDS` for each request, an answer that the client does not read is dropped after
:data:`ANSWER_SECONDS`, and if there are more than :data:`MOST` connections, an idle one or else the oldest is closed.
"""

import asyncio
from collections.abc import Iterable
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

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
        """Close a connection if there are too many, and start to wait for the request."""
        # one turn of the loop accepts many: connections that were aborted in this turn are still listed, but count as
        # closed
        known: list[Any] = [each for each in self.connections if isinstance(each, BoundedProtocol)]
        others = [each for each in known if not each.transport.is_closing()]
        super().connection_made(transport)
        self.made_at = self.loop.time()
        if len(others) >= MOST:
            _victim(others).abort()
        self._await_request()

    def data_received(self, data: bytes) -> None:
        """Receive part of a request; stop the timer when the request is complete."""
        if self._request_timer is None and not self.answering:
            self._await_request()
        super().data_received(data)
        if self.answering:
            _cancel(self._request_timer)
            self._request_timer = None

    def on_response_complete(self) -> None:
        """From here on, uvicorn's timer applies to the idle connection, and our timer to the next request."""
        _cancel(self._request_timer)
        self._request_timer = None
        super().on_response_complete()

    def pause_writing(self) -> None:
        """Start the timer: the client reads too slowly."""
        super().pause_writing()
        _cancel(self._answer_timer)
        self._answer_timer = None
        self._answer_timer = self.loop.call_later(ANSWER_SECONDS, self.abort)

    def resume_writing(self) -> None:
        """Stop the timer: the client has caught up."""
        _cancel(self._answer_timer)
        self._answer_timer = None
        super().resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        """Cancel the timers."""
        _cancel(self._request_timer)
        self._request_timer = None
        _cancel(self._answer_timer)
        self._answer_timer = None
        super().connection_lost(exc)

    def abort(self) -> None:
        """Close the connection immediately."""
        self.transport.abort()

    def _await_request(self) -> None:
        self._request_timer = self.loop.call_later(REQUEST_SECONDS, self.abort)


def _victim(connections: Iterable[Any]) -> Any:
    """An idle connection, else the oldest."""
    return min(connections, key=lambda each: (each.answering, each.made_at))


def _cancel(timer: asyncio.TimerHandle | None) -> None:
    if timer is not None:
        timer.cancel()
