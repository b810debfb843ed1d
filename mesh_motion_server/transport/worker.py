"""A worker: one session's process, with its socket.

It handles one request at a time: frames → message → host → replies → frames. While it computes it answers no other
request; the gateway answers whether it is alive (PROBE). :mod:`.template` starts it.

The lease holds while any connection is open. ``lease_seconds`` after the last one the session is suspended, and after
``idle_seconds`` the process ends; the session stays resumable. A session without a mesh ends with its lease.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import zmq
from mesh_motion_protocol.arrays import Buffer
from mesh_motion_protocol.codec import decode
from mesh_motion_protocol.errors import MeshMotionError, ProtocolError
from mesh_motion_protocol.messages import CONTROL, REPLIES, ErrorReply, Message, Ping, Pong

from mesh_motion_server.failpoints import failpoint
from mesh_motion_server.operation.tally import TALLY
from mesh_motion_server.security.authorisation import Verdict
from mesh_motion_server.service.envelope import Envelope
from mesh_motion_server.service.error_replies import error_reply
from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.channel import Channel
from mesh_motion_server.transport.endpoints import connection_event
from mesh_motion_server.transport.processes import return_memory
from mesh_motion_server.transport.protection import Rights
from mesh_motion_server.transport.replies import encoded, undecodable, unexpected
from mesh_motion_server.transport.telemetry import log, log_suppressed

if TYPE_CHECKING:
    from mesh_motion_server.service.dispatch import SessionHost

_DATA = REPLIES.keys() - CONTROL
#: Counts are sent after each of these, and otherwise at this interval, seconds: a killed worker loses no more.
_STEPS = frozenset({"BUILD", "MOVE", "COMMIT"})
_TALLY_SECONDS = 1.0


class Lease:
    """Follows the open connections of a socket and the time since the last one ended.

    Connections are identified by their descriptors, so the end of a failed handshake does not end another connection.
    Clients that only watch do not keep the lease.
    """

    def __init__(self, socket: zmq.Socket[bytes], now: float) -> None:
        self.monitor = socket.get_monitor_socket(zmq.EVENT_ACCEPTED | zmq.EVENT_DISCONNECTED)
        self._connections: set[int] = set()
        self._alone_since = now

    def update(self, now: float) -> None:
        """Read the monitor's events."""
        while self.monitor.poll(0):
            event, descriptor = connection_event(self.monitor)
            if event == zmq.EVENT_ACCEPTED:
                self._connections.add(descriptor)
            elif descriptor in self._connections:
                self._connections.remove(descriptor)
                self._alone_since = now
                return_memory()  # that of a message that was cut

    def pass_over(self, frame: zmq.Frame, now: float) -> None:
        """Do not count the connection that a frame came from."""
        self.update(now)  # otherwise its start would be read later
        self._connections.discard(int(frame.get(zmq.SRCFD)))

    def alone(self, now: float) -> float:
        """Return the seconds without any connection."""
        return 0.0 if self._connections else now - self._alone_since


class Worker:
    """Serves one session's data endpoint.

    Parameters
    ----------
    channel : Channel
        Channel to the supervisor.
    socket : zmq.Socket
        Bound ROUTER.
    rights : Rights
        The rights of each user in this session.
    """

    def __init__(
        self, channel: Channel, socket: zmq.Socket[bytes], host: SessionHost, settings: ServerSettings, rights: Rights
    ) -> None:
        self._channel = channel
        self._socket = socket
        self._host = host
        self._rights = rights
        self._settings = settings
        self._lease = Lease(socket, time.monotonic())
        self._reported: dict[str, Any] = {}
        self._tally_due = 0.0
        self._suspended = False
        self._over = False

    def run(self, signals: Any) -> None:
        """Serve until the session is closed or idle for too long, or the supervisor orders a drain or is gone."""
        poller = zmq.Poller()
        for source in (self._socket, self._channel.fileno(), self._lease.monitor, signals.fileno()):
            poller.register(source, zmq.POLLIN)
        while not (self._over or self._host.closed):
            ready = dict(poller.poll(self._patience()))
            if signals.fileno() in ready:
                return
            if self._channel.fileno() in ready:
                self._obey()
            elif self._socket in ready:
                self._receive()
            self._keep_time()
            self._report()

    def disconnect(self) -> None:
        """Stop watching connections; the socket itself still sends what is queued."""
        self._socket.disable_monitor()
        self._lease.monitor.close()

    def _patience(self) -> int:
        """Return the milliseconds until the next timed action."""
        waits = [self._settings.lease_seconds / 4, 15.0]
        if TALLY:
            waits.append(_TALLY_SECONDS)
        if self._host.next_deadline is not None:
            waits.append(max(0.0, self._host.next_deadline - time.monotonic()))
        return math.ceil(1000 * min(waits))

    def _obey(self) -> None:
        """Handle the supervisor's orders: drain, reclaim."""
        order = self._channel.receive()
        if order is None or order["order"] == "drain":
            failpoint("worker.drain")
            self._over = True
            return
        failpoint("worker.reclaim")
        self._channel.send({"event": "reclaiming"})
        try:
            epoch = self._host.reclaim(order["token"])
        except MeshMotionError as error:
            self._channel.send({"event": "not_reclaimed", "reason": error.message})
            return
        self._suspended = False
        self._channel.send(
            {"event": "reclaimed", "epoch": epoch, "state": str(self._host.state), "step": self._host.step}
        )

    def _receive(self) -> None:
        """Handle one request, from its frames to the frames of its replies."""
        peer, *parts = self._socket.recv_multipart(copy=False)
        failpoint("worker.received")
        started = time.perf_counter()
        TALLY.count("received_bytes", sum(map(len, parts)))
        user = self._rights.user(parts[-1] if parts else peer)
        owns = self._rights.is_owner(user)
        state = str(self._host.state) if owns else ""
        if not owns:
            self._lease.pass_over(parts[-1] if parts else peer, time.monotonic())
        try:
            request = decode([part.buffer for part in parts])
        except ProtocolError as error:
            log().warning("refused", code=error.code, frames=len(parts))
            self._send([Envelope(peer.bytes, undecodable(error, state=state))])
            return
        except MemoryError:
            shortage = ProtocolError("no memory for the arrays of the message", code="RESOURCE_EXHAUSTED.MEMORY")
            self._send([Envelope(peer.bytes, undecodable(shortage, state=state))])
            return
        replies = self._answer(Envelope(peer.bytes, request), user, state)
        if self._host.closed:
            self._report()  # the client may open the next session as soon as it has the reply
        self._send(replies)
        if request.type in _STEPS:
            self._tally_due = 0.0
        milliseconds = round(1000 * (time.perf_counter() - started), 3)
        log().debug("served", request=request.type, sequence=request.sequence, ms=milliseconds, state=str(state))

    def _answer(self, asked: Envelope, user: str, state: str) -> Sequence[Envelope]:
        request = asked.message
        if request.type not in _DATA and not isinstance(request, Ping):
            return [Envelope(asked.peer, unexpected(request, "data", state=state))]
        try:
            verdict = self._rights.check(user, request)
        except MeshMotionError as error:
            log().info("refused", request=request.type, code=error.code)
            return [Envelope(asked.peer, error_reply(request, error))]
        if isinstance(request, Ping):
            return [Envelope(asked.peer, Pong(client=request.client, sequence=request.sequence))]
        if verdict is Verdict.OVERSEE:
            return self._host.oversee(asked)
        self._suspended = False
        return self._host.handle(asked)

    def _send(self, envelopes: Sequence[Envelope]) -> None:
        for envelope in envelopes:
            frames = encoded(envelope.message, state=str(self._host.state), memory=self._shared(envelope))
            failpoint("worker.sending")
            _count(envelope.message, frames)
            try:
                self._socket.send_multipart([envelope.peer, *frames], flags=zmq.NOBLOCK, copy=False)
                failpoint("worker.sent")
            except zmq.ZMQError as error:
                # The peer is gone or does not read: it will repeat the request with the same request id.
                log().info("undelivered", reply=envelope.message.type, reason=str(error))

    def _shared(self, reply: Envelope) -> Mapping[str, Any] | None:
        """Return memory for a reply's arrays; only on ipc, whose folder only the server's own user can enter."""
        local = reply.memory and self._socket.getsockopt(zmq.LAST_ENDPOINT)[:4] == b"ipc:"  # type: ignore[index]
        return reply.memory if local else None

    def _keep_time(self) -> None:
        """Handle expired collective requests, the lease, and the end of an idle process."""
        now = time.monotonic()
        log_suppressed()
        if self._host.next_deadline is not None and self._host.next_deadline <= now:
            self._send(self._host.expire(now))
        self._lease.update(now)
        alone = self._lease.alone(now)
        if alone >= self._settings.lease_seconds and not self._suspended:
            self._suspended = True
            failpoint("worker.lease-end")
            log().info("lease_ended", state=str(self._host.state), step=self._host.step)
            self._send(self._host.suspend())
        self._over = self._over or alone >= self._settings.idle_seconds

    def _report(self) -> None:
        """Report the session's state to the supervisor if it has changed, and the counts since the last report."""
        host = self._host
        now = {"state": str(host.state), "step": host.step, "epoch": host.epoch, "suspended": self._suspended}
        if now == self._reported and not (TALLY and time.monotonic() >= self._tally_due):
            return
        taken = TALLY.take()
        if self._channel.offer({"event": "status", "tally": taken} | now):
            self._reported, self._tally_due = now, time.monotonic() + _TALLY_SECONDS
        else:
            TALLY.add(taken)  # the supervisor's queue is full; the client does not wait for it


def _count(reply: Message, frames: Sequence[Buffer]) -> None:
    TALLY.count("sent_bytes", sum(map(len, frames)))
    if isinstance(reply, ErrorReply):
        TALLY.count("refused", label=reply.code)
