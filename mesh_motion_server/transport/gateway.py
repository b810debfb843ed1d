"""The control endpoint: one ROUTER socket for headers only, in its own process with little memory.

It decodes, answers HELLO and PING itself and passes OPEN, RESUME, LIST, PROBE on to the supervisor, which knows the
sessions. It has no state, so the supervisor may restart it at any time.

On a server with keys it also decides every handshake, its own and the workers' (:mod:`.authenticator`), and tests this
before it reports that it is bound (:mod:`.self_test`).
"""

import contextlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import zmq
from mesh_motion_protocol import PROTOCOL_VERSION
from mesh_motion_protocol.codec import decode
from mesh_motion_protocol.errors import MeshMotionError, ProtocolError
from mesh_motion_protocol.limits import HEADER_BYTES
from mesh_motion_protocol.messages import CONTROL, ErrorReply, Hello, Message, Ping, Pong, Welcome
from mesh_motion_protocol.shared_memory import FEATURE, SUPPORTED

from mesh_motion_server.failpoints import activate, failpoint
from mesh_motion_server.operation.room import resident_bytes
from mesh_motion_server.operation.tally import TALLY
from mesh_motion_server.security.allow_list import AllowList
from mesh_motion_server.security.authorisation import Verdict, refusal
from mesh_motion_server.service.error_replies import error_reply
from mesh_motion_server.transport.authenticator import Authenticator
from mesh_motion_server.transport.channel import Channel
from mesh_motion_server.transport.endpoints import Endpoint, bind, router
from mesh_motion_server.transport.processes import limit_address_space, limit_descriptors, return_memory
from mesh_motion_server.transport.protection import Protection, keep_secrets_out_of_core_files, user_of
from mesh_motion_server.transport.replies import encoded, undecodable, unexpected
from mesh_motion_server.transport.self_test import ProtectionError, check_admits, check_refuses
from mesh_motion_server.transport.telemetry import configure, log, log_suppressed

#: Bytes beyond what Python and zmq map: queues of headers.
_MEMORY = 512 << 20
#: Memory beyond that of the start that the C library may keep.
_KEPT = 32 << 20
#: Headers queued per client and direction: one of 64 KiB each, so a slow client holds at most 4 MiB.
_QUEUED = 32
#: Largest number of open files and connections; further connections wait in the kernel until some have ended.
_DESCRIPTORS = 4096


class Gateway:
    """Moves headers between the control socket and the supervisor.

    Parameters
    ----------
    channel : Channel
        Channel to the supervisor.
    socket : zmq.Socket
        Bound ROUTER.
    welcome : dict
        Content of WELCOME: server, boot, limits, durability.
    features : sequence of str
        Optional parts of the protocol that this server supports.
    protection : Protection, optional
        Protection of the socket, on a server with keys.
    insecure : bool
        Whether other machines reach the endpoint without keys: HELLOs are then counted.
    """

    def __init__(
        self,
        channel: Channel,
        socket: zmq.Socket[bytes],
        welcome: dict[str, Any],
        *,
        features: Sequence[str] = (),
        protection: Protection | None = None,
        insecure: bool = False,
    ) -> None:
        self._channel = channel
        self._socket = socket
        self._welcome = welcome
        self._features = features
        self._protection = protection
        self._access = Protection.access(protection)
        self._insecure_hellos = 0 if insecure else None
        self._most_memory = resident_bytes(os.getpid()) + _KEPT

    def run(self, authenticator: Authenticator | None = None) -> None:
        """Work until the supervisor closes the channel."""
        poller = zmq.Poller()
        poller.register(self._socket, zmq.POLLIN)
        poller.register(self._channel.fileno(), zmq.POLLIN)
        if authenticator is not None:
            poller.register(authenticator.socket, zmq.POLLIN)
        while True:
            ready = dict(poller.poll())
            if self._channel.fileno() in ready:
                order = self._channel.receive()
                if order is None:
                    return
                self._obey(order)
            if authenticator is not None and authenticator.socket in ready:
                authenticator.answer()
            if self._socket in ready:
                self._receive()

    def _obey(self, order: dict[str, Any]) -> None:
        """Handle an order: send a reply to a client, or confirm that this loop runs."""
        if "frame" in order:
            self._send(order["peer"], [order["frame"]])
        else:
            log_suppressed()
            if resident_bytes(os.getpid()) > self._most_memory:
                return_memory()
            taken = TALLY.take()
            if not self._channel.offer({"event": "pong", "tally": taken}):
                TALLY.add(taken)  # the supervisor's queue is full, and it will ask again

    def _receive(self) -> None:
        peer, *parts = self._socket.recv_multipart(copy=False)
        failpoint("gateway.received")
        TALLY.count("received_bytes", sum(map(len, parts)))
        self._take(peer.bytes, user_of(parts[-1] if parts else peer, self._protection), [p.bytes for p in parts])

    def _take(self, peer: bytes, user: str, frames: list[bytes]) -> None:
        """Handle one request of a user."""
        try:
            request = decode(frames)
        except ProtocolError as error:
            log().warning("refused", code=error.code, frames=len(frames))
            self._reply(peer, undecodable(error))
            return
        try:
            self._check_known(request, user)
        except MeshMotionError as error:
            self._reply(peer, error_reply(request, error))
            return
        if isinstance(request, Hello):
            self._reply(peer, self._greet(request))
        elif isinstance(request, Ping):
            self._reply(peer, Pong(client=request.client, sequence=request.sequence))
        elif request.type in CONTROL:
            failpoint("gateway.forward")
            if not self._channel.offer({"peer": peer, "user": user, "frame": frames[0]}):
                self._reply(peer, error_reply(request, _busy()))
        else:
            self._reply(peer, unexpected(request, "control"))

    def _check_known(self, request: Message, user: str) -> None:
        """Raise if a key was removed from the allow-list after it connected."""
        roles = self._access.roles(user)
        if not roles:
            raise refusal(Verdict.UNKNOWN, request.type)

    def _greet(self, hello: Hello) -> Message:
        """Return WELCOME with the common version, or the versions that this server speaks."""
        major, minor = PROTOCOL_VERSION
        offered = [version for version in hello.versions if len(version) == 2 and min(version) >= 0]
        theirs = [version[1] for version in offered if version[0] == major]
        if not theirs:
            error = MeshMotionError(
                f"this server speaks protocol {major}.{minor}, the client offers {hello.versions!r:.80}",
                code="UNIMPLEMENTED.VERSION",
                details={"versions": [[major, minor]]},
            )
            return error_reply(hello, error)
        if self._insecure_hellos is not None:
            self._insecure_hellos += 1
            log().warning("insecure_hello", count=self._insecure_hellos)
        log().info("hello", agent=hello.agent)
        version = [major, min(minor, max(theirs))]
        features = [name for name in self._features if name in hello.features]
        welcome = self._welcome | {"version": version, "features": features}
        return Welcome(client=hello.client, sequence=hello.sequence, **welcome)

    def _reply(self, peer: bytes, reply: Message) -> None:
        if isinstance(reply, ErrorReply):
            TALLY.count("refused", label=reply.code)
        self._send(peer, [bytes(frame) for frame in encoded(reply)])

    def _send(self, peer: bytes, frames: list[bytes]) -> None:
        """Send; drop the message if the peer is gone or does not read."""
        failpoint("gateway.reply")
        TALLY.count("sent_bytes", sum(map(len, frames)))
        with contextlib.suppress(zmq.Again, zmq.ZMQError):
            self._socket.send_multipart([peer, *frames], flags=zmq.NOBLOCK)


def _busy() -> MeshMotionError:
    """Return the error for a request that the supervisor cannot accept: nothing was started."""
    return MeshMotionError("the server has too many waiting requests", code="UNAVAILABLE")


def main(channel: Channel, level: str) -> int:
    """Run the gateway's process; the channel's first message configures it."""
    configure("gateway", level)
    activate()
    failpoint("gateway.start")
    order = channel.receive()
    if order is None:
        return 0
    limit_descriptors(_DESCRIPTORS)
    protection = Protection.of_order(order)
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    authenticator = _authenticator(context, protection)
    socket = router(context, message_bytes=HEADER_BYTES, queued=_QUEUED, handshake_seconds=order["handshake_seconds"])
    try:
        endpoint = _listen(socket, order["endpoint"], protection, authenticator)
    except (zmq.ZMQError, ProtectionError) as error:
        channel.send({"event": "unbound", "reason": str(error), "unprotected": isinstance(error, ProtectionError)})
        return 1
    channel.send({"event": "bound", "endpoint": endpoint})
    limit_address_space(_MEMORY)
    features = [FEATURE] if SUPPORTED and endpoint.startswith("ipc:") else []
    insecure: bool = order["insecure"]
    gateway = Gateway(channel, socket, order["welcome"], features=features, protection=protection, insecure=insecure)
    gateway.run(authenticator)
    socket.close(linger=1000)
    if authenticator is not None:
        authenticator.close()
    context.term()
    return 0


def _authenticator(context: zmq.Context[zmq.Socket[bytes]], protection: Protection | None) -> Authenticator | None:
    """Return the handler that decides handshakes, on a server with keys."""
    if protection is None:
        return None
    keep_secrets_out_of_core_files()
    return Authenticator(context, AllowList(Path(protection.allow_list)), protection.handshakes)


def _listen(
    socket: zmq.Socket[bytes], address: str, protection: Protection | None, authenticator: Authenticator | None
) -> str:
    """Bind; with keys, only if real connections show that they are checked. Raises ProtectionError."""
    if protection is None or authenticator is None:
        return bind(socket, Endpoint.parse(address).address)
    protection.protect(socket)
    endpoint = bind(socket, Endpoint.parse(address).address)
    public, secret = zmq.curve_keypair()
    authenticator.guest = public.decode()
    check_admits(endpoint, protection, secret, authenticator.answer_waiting)
    authenticator.guest = ""
    check_refuses(endpoint, protection, authenticator.answer_waiting)
    log().info("self_test_passed", endpoint=endpoint)
    return endpoint
