"""The control endpoint: one ROUTER socket for headers only, in a process of its own with little memory.

It decodes, answers HELLO and PING itself and passes OPEN, RESUME, LIST, PROBE on to the supervisor, which knows the
sessions. It holds nothing, so the supervisor may start it again at any time.
"""

from __future__ import annotations

import contextlib
import sys
from typing import Any

import zmq
from mesh_motion_protocol import PROTOCOL_VERSION
from mesh_motion_protocol.codec import decode, encode
from mesh_motion_protocol.errors import ProtocolError
from mesh_motion_protocol.limits import HEADER_BYTES
from mesh_motion_protocol.messages import CONTROL, Hello, Message, Ping, Pong, Welcome

from mesh_motion_server.errors import MeshMotionError
from mesh_motion_server.transport.channel import Channel
from mesh_motion_server.transport.endpoints import Endpoint, bind, router
from mesh_motion_server.transport.processes import die_with_parent, limit_address_space
from mesh_motion_server.transport.replies import error_reply, undecodable, unexpected
from mesh_motion_server.transport.telemetry import configure, log

__all__ = ["Gateway", "main"]

#: Beyond what Python and zmq map: queues of headers.
_MEMORY = 512 << 20
_QUEUED = 32


class Gateway:
    """Moves headers between the control socket and the supervisor.

    Parameters
    ----------
    channel : Channel
        To the supervisor.
    socket : zmq.Socket
        Bound ROUTER.
    welcome : dict
        What WELCOME says: server, boot, limits, durability.
    """

    def __init__(self, channel: Channel, socket: zmq.Socket[bytes], welcome: dict[str, Any]) -> None:
        self._channel = channel
        self._socket = socket
        self._welcome = welcome

    def run(self) -> None:
        """Work until the supervisor closes the channel."""
        poller = zmq.Poller()
        poller.register(self._socket, zmq.POLLIN)
        poller.register(self._channel.fileno(), zmq.POLLIN)
        while True:
            ready = dict(poller.poll())
            if self._channel.fileno() in ready:
                order = self._channel.receive()
                if order is None:
                    return
                self._send(order["peer"], [order["frame"]])
            if self._socket in ready:
                self._receive()

    def _receive(self) -> None:
        peer, *frames = self._socket.recv_multipart()
        try:
            request = decode(frames)
        except ProtocolError as error:
            log().warning("refused", code=error.code, frames=len(frames))
            self._reply(peer, undecodable(error))
            return
        if isinstance(request, Hello):
            self._reply(peer, self._greet(request))
        elif isinstance(request, Ping):
            self._reply(peer, Pong(client=request.client, sequence=request.sequence))
        elif request.type in CONTROL:
            self._channel.send({"peer": peer, "frame": frames[0]})
        else:
            self._reply(peer, unexpected(request, "control"))

    def _greet(self, hello: Hello) -> Message:
        """WELCOME with the common version, or the versions we speak."""
        major, minor = PROTOCOL_VERSION
        theirs = [version[1] for version in hello.versions if version[:1] == [major] and len(version) == 2]
        if not theirs:
            error = MeshMotionError(
                f"this server speaks protocol {major}.{minor}, the client offers {hello.versions!r:.80}",
                code="UNIMPLEMENTED.VERSION",
                details={"versions": [[major, minor]]},
            )
            return error_reply(hello, error)
        log().info("hello", agent=hello.agent)
        version = [major, min(minor, max(theirs))]
        return Welcome(client=hello.client, sequence=hello.sequence, version=version, features=[], **self._welcome)

    def _reply(self, peer: bytes, reply: Message) -> None:
        self._send(peer, [bytes(frame) for frame in encode(reply)])

    def _send(self, peer: bytes, frames: list[bytes]) -> None:
        """Send, or drop for a peer that is gone or does not read."""
        with contextlib.suppress(zmq.Again, zmq.ZMQError):
            self._socket.send_multipart([peer, *frames], flags=zmq.NOBLOCK)


def main(arguments: list[str]) -> int:
    """``python -m mesh_motion_server.transport.gateway CHANNEL LEVEL``; the channel's first message configures it."""
    die_with_parent()
    channel = Channel.inherited(int(arguments[0]))
    configure("gateway", arguments[1])
    order = channel.receive()
    if order is None:
        return 0
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    socket = router(context, message_bytes=HEADER_BYTES, queued=_QUEUED)
    try:
        endpoint = bind(socket, Endpoint.parse(order["endpoint"]).address)
    except zmq.ZMQError as error:
        channel.send({"event": "unbound", "reason": str(error)})
        return 1
    channel.send({"event": "bound", "endpoint": endpoint})
    limit_address_space(_MEMORY)
    Gateway(channel, socket, order["welcome"]).run()
    socket.close(linger=1000)
    context.term()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
