"""The supervisor's line to the gateway: it sends without waiting and restarts a gateway that has ended.

The supervisor waits for the first start only, before it serves any client. Later starts are events like all others, so
a gateway that hangs while it starts blocks nothing: it is killed after its time limit, and another one is started.
"""

import selectors
import time
from collections.abc import Callable
from typing import Any

from mesh_motion_server.failpoints import failpoint
from mesh_motion_server.operation.tally import TALLY
from mesh_motion_server.transport.channel import Outbox
from mesh_motion_server.transport.endpoints import EndpointError
from mesh_motion_server.transport.processes import Attempts, Child
from mesh_motion_server.transport.self_test import ProtectionError
from mesh_motion_server.transport.telemetry import log

#: More failed starts than this in an hour have a cause that one more start does not remove. A gateway that listened and
#: then failed does not count: the sessions work without it, and a client that makes it fail must not end them.
_STARTS = 20
#: Seconds before the next start after a failed start, or after a failure within the longest pause; doubled each time up
#: to the limit, because a lack of memory or processes can last.
_PAUSE, _LONGEST_PAUSE = 0.2, 5.0
#: Seconds within which the gateway must import, bind and test itself; on an idle machine it needs some tenths of a
#: second.
_START_SECONDS = 60.0
#: Replies kept for a gateway that does not read, at most 64 KiB each.
_KEPT_REPLIES = 256


class GatewayLine:
    """Starts the gateway, reads its messages and sends it replies.

    Parameters
    ----------
    selector : selectors.BaseSelector
        The supervisor's: each source has the function that is called when it becomes readable.
    endpoint : str
        The endpoint of the gateway.
    launch : callable
        Starts a process with the order to listen there.
    request : callable
        Peer, user and frame of a control request.

    Attributes
    ----------
    endpoint : str
        The endpoint after the start: port 0 is replaced by the actual port.
    answered_at : float
        Time of the gateway loop's last answer, on the monotonic clock.
    """

    def __init__(
        self,
        selector: selectors.BaseSelector,
        endpoint: str,
        launch: Callable[[str], Child],
        request: Callable[[bytes, str, bytes], None],
    ) -> None:
        self.endpoint = endpoint
        self.child: Child | None = None
        self.answered_at = time.monotonic()
        self._listens_since: float | None = None
        self._selector = selector
        self._launch = launch
        self._request = request
        self._attempts = Attempts(_STARTS)
        self._pause = _PAUSE
        self._due = 0.0  # time by which it must listen, or must be started
        self._asked_at: float | None = None
        self._outbox: Outbox | None = None

    def start(self) -> None:
        """Start the gateway for the first time; it listens on return.

        Raises EndpointError if it cannot listen; ProtectionError if it admits or refuses the wrong keys.
        """
        self._attempts.note(time.monotonic())
        gateway = self._launch(self.endpoint)
        answer = gateway.channel.receive(_START_SECONDS)
        if answer is None or answer["event"] != "bound":
            gateway.reap()
            if answer is not None and answer["unprotected"]:
                raise ProtectionError(answer["reason"])
            reason = answer["reason"] if answer else "the gateway ended, or did not start in time"
            free = "stop the program that listens there, or use another endpoint"
            raise EndpointError(
                f"cannot listen on {self.endpoint}: {reason}",
                hint=free if answer else "the lines before this one in the log say why",
            )
        self._take(gateway)
        self._bound(answer["endpoint"])

    @property
    def lost(self) -> bool:
        """Whether the gateway has failed too often and is not restarted."""
        return self.child is None and self._attempts.over(time.monotonic())

    # --- to it -------------------------------------------------------------------------------------------------------

    def reply(self, peer: bytes, frame: bytes) -> None:
        """Pass a reply on. If it is lost because the gateway fails or does not read, the client asks again."""
        if self.child is None or self._outbox is None:
            return
        if not self._outbox.put({"peer": peer, "frame": frame}):
            log().warning("undelivered", reason="the gateway does not read")
        self._await_room()

    def ask(self, now: float, patience: float) -> None:
        """Ask if the gateway's loop runs; ``answered_at`` has the last answer. Ask again after ``patience`` seconds."""
        waiting = self._asked_at is not None and now - self._asked_at < patience
        if self.child is not None and not waiting and self.child.channel.offer({"order": "ping"}):
            self._asked_at = now

    def _await_room(self) -> None:
        """Wake up when there is room for the kept replies."""
        if self.child is not None and self._outbox is not None:
            events = selectors.EVENT_READ | (selectors.EVENT_WRITE if self._outbox else 0)
            key = self._selector.get_key(self.child.channel)
            if key.events != events:
                self._selector.modify(self.child.channel, events, key.data)

    # --- from it -----------------------------------------------------------------------------------------------------

    def _turned(self, _source: Any) -> None:
        """Handle an event of the gateway: there is room for replies, or it has sent a message or ended."""
        if self.child is None or self._outbox is None:
            return
        self._outbox.flush()
        self._await_room()
        if self.child.channel.pending():
            self._receive(self.child)

    def _receive(self, gateway: Child) -> None:
        message = gateway.channel.receive()
        if message is None:
            self._ended(gateway)
        elif "frame" in message:
            failpoint("supervisor.request")
            self._request(message["peer"], message["user"], message["frame"])
        elif message["event"] == "pong":
            self._alive()
            TALLY.add(message["tally"])
        elif message["event"] == "bound":
            self._bound(message["endpoint"])
        else:
            log().error("gateway_not_started", reason=message["reason"])

    def _bound(self, endpoint: str) -> None:
        self.endpoint, self._listens_since, self._attempts = endpoint, time.monotonic(), Attempts(_STARTS)
        TALLY.count("gateway_starts")
        self._alive()

    def _alive(self) -> None:
        self.answered_at, self._asked_at = time.monotonic(), None

    # --- its life ----------------------------------------------------------------------------------------------------

    def _take(self, gateway: Child) -> None:
        self.child, self._listens_since, self._outbox = gateway, None, Outbox(gateway.channel, _KEPT_REPLIES)
        self._due = time.monotonic() + _START_SECONDS
        self._alive()
        self._selector.register(gateway.channel, selectors.EVENT_READ, self._turned)

    def _ended(self, gateway: Child) -> None:
        self._selector.unregister(gateway.channel)
        failpoint("supervisor.gateway-ended")
        TALLY.count("gateway_falls")
        log().error("gateway_ended", code=gateway.reap())
        self.child, self._outbox = None, None
        now = time.monotonic()
        if self._listens_since is not None and now - self._listens_since > _LONGEST_PAUSE:
            self._due, self._pause = now, _PAUSE
        else:
            self._due = now + self._next_pause()

    def next_deadline(self) -> float | None:
        """Return when :meth:`keep_time` must run next."""
        return None if self._listens_since is not None and self.child is not None else self._due

    def keep_time(self, now: float) -> None:
        """Restart a gateway that has ended; kill one that does not start to listen in time."""
        if now < self._due or self.lost:
            return
        if self.child is None:
            self._attempts.note(now)
            try:
                self._take(self._launch(self.endpoint))
            except OSError as error:
                self._due = now + self._next_pause()
                log().error("gateway_not_started", reason=str(error))
        elif self._listens_since is None:
            log().error("gateway_not_started", reason=f"silent for {_START_SECONDS:.0f} s")
            self._due = now + _START_SECONDS
            self.child.kill()

    def _next_pause(self) -> float:
        pause, self._pause = self._pause, min(2 * self._pause, _LONGEST_PAUSE)
        return pause

    def stop(self) -> None:
        """Close the line, which ends the gateway."""
        if self.child is not None:
            self._selector.unregister(self.child.channel)
            self.child.reap()
            self.child = None
