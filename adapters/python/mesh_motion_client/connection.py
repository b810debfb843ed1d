"""One connection: sends a request, returns its reply, and detects a lost connection.

ZeroMQ hides a lost connection: it connects again, and a request that was on its way is lost without an error. So this
module watches the socket's own events: :class:`ConnectionLost` means that the request must be sent again with the same
id.
"""

from __future__ import annotations

import os
import re
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import zmq
from mesh_motion_protocol.codec import decode, encode
from mesh_motion_protocol.errors import (
    InvalidInput,
    ProtocolError,
    ServerFault,
    SessionError,
    Timeout,
    Unavailable,
    error_from,
)
from mesh_motion_protocol.lacks import way_out_of
from mesh_motion_protocol.limits import FRAME_BYTES
from mesh_motion_protocol.messages import REPLIES, ErrorReply, Message
from mesh_motion_protocol.shared_memory import SharedMemory

from mesh_motion_client.keys import Keys

__all__ = ["Connection", "ConnectionLost", "DamagedReply", "check_process", "seconds_left", "turn"]

#: Seconds of silence after which ``watch`` is called.
_WATCH_SECONDS = 1.0
#: Largest frame that is accepted: the protocol's largest frame, and the bytes that CURVE adds.
_MOST_BYTES = FRAME_BYTES + 64
#: Limit on each call of the socket, in case the code below waits wrongly: sends do not wait, receives follow a poll.
_MOST_MILLISECONDS = 60_000
_LAST_PORT = 65535
#: libzmq also takes what no server can listen at, such as port 99999, and waits for it.
_ENDPOINT = re.compile(r"tcp://[^/]+:([0-9]{1,5})|ipc://.+")
_WATCHED = zmq.EVENT_DISCONNECTED | zmq.EVENT_HANDSHAKE_FAILED_AUTH | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL


class ConnectionLost(Unavailable):
    """The connection ended before the reply came: the request may have executed or not."""


class DamagedReply(ServerFault):
    """The received frames are not a message: the request may have executed or not; the same call may be repeated."""


class Connection:
    """A DEALER socket to one endpoint, used by one thread at a time.

    Parameters
    ----------
    keys : Keys, optional
        For a server that requires keys.
    """

    def __init__(self, endpoint: str, keys: Keys | None = None) -> None:
        self.endpoint = endpoint
        self._process = os.getpid()
        self._socket, self._events = _sockets()
        self._socket.setsockopt(zmq.MAXMSGSIZE, _MOST_BYTES)
        self._socket.setsockopt(zmq.RECONNECT_IVL, 50)
        self._socket.setsockopt(zmq.RECONNECT_IVL_MAX, 1000)
        # a server whose machine has disappeared sends nothing, not even the end of the connection
        self._socket.setsockopt(zmq.HEARTBEAT_IVL, 5_000)
        self._socket.setsockopt(zmq.HEARTBEAT_TIMEOUT, 20_000)
        self._socket.setsockopt(zmq.IPV6, int("[" in str(endpoint)))
        try:
            if keys is not None:
                keys.protect(self._socket)
            found = _ENDPOINT.fullmatch(endpoint)
            if not found or not 1 <= int(found[1] or 1) <= _LAST_PORT:
                raise _no_endpoint(endpoint)
            self._socket.connect(endpoint)
        except InvalidInput:
            self.close()
            raise
        except (zmq.ZMQError, TypeError) as error:
            self.close()
            raise _no_endpoint(endpoint) from error

    def request(
        self,
        message: Message,
        deadline: float,
        watch: Callable[[], None] | None = None,
        memory: SharedMemory | None = None,
    ) -> Message:
        """Send a request and wait for its reply.

        Parameters
        ----------
        message : Message
            Its arrays must stay unchanged until the reply has arrived.
        deadline : float
            On the monotonic clock.
        watch : callable, optional
            Called after each second without a reply; it may raise an error to end the wait.
        memory : SharedMemory, optional
            Memory that the request offers for the reply's arrays.

        Raises
        ------
        ConnectionLost, Timeout, MeshMotionError
            MeshMotionError for an ERROR reply of the server.
        """
        self._check_connected()
        self._send(message)
        while True:
            reply = self._receive(message, deadline, watch, memory)
            if (reply.client, reply.sequence) != (message.client, message.sequence):
                continue  # the late reply to an earlier request
            if isinstance(reply, ErrorReply):
                raise error_from(reply)
            if reply.type != REPLIES[message.type]:
                raise ServerFault(f"the reply to {message.type} must be {REPLIES[message.type]}, got {reply.type}")
            return reply

    def _send(self, message: Message) -> None:
        try:
            self._socket.send_multipart(encode(message), flags=zmq.NOBLOCK, copy=False)
        except ProtocolError as error:
            raise InvalidInput(error.message, code=error.code, hint=error.hint, details=error.details) from None
        except zmq.Again:  # ZeroMQ gave the connection up after the check: a send that waits would never return
            self._check_connected()
            raise ConnectionLost(f"the connection to {self.endpoint} ended") from None

    def _receive(
        self, message: Message, deadline: float, watch: Callable[[], None] | None, memory: SharedMemory | None
    ) -> Message:
        """Receive the next message, of any type."""
        while not self._socket.poll(0):
            self._wait(min(seconds_left(deadline), _WATCH_SECONDS))
            if self._socket.poll(0):
                break
            self._check_connected()
            if not seconds_left(deadline):
                raise Timeout(f"no answer to {message.type} from {self.endpoint} within the time allowed")
            if watch is not None:
                watch()
        try:
            return decode([frame.buffer for frame in self._socket.recv_multipart(copy=False)], memory=memory)
        except ProtocolError as error:
            self.close()  # later messages on this connection cannot be trusted either
            raise DamagedReply(f"the server's reply is not a message: {error.message}", code=error.code) from None

    def _wait(self, seconds: float) -> None:
        """Wait for a reply or an event, at most until the time is over."""
        poller = zmq.Poller()
        poller.register(self._socket, zmq.POLLIN)
        poller.register(self._events, zmq.POLLIN)
        poller.poll(round(1000 * seconds))

    def _check_connected(self) -> None:
        lost = False
        while self._events.poll(0):
            # zmq.utils.monitor would read it in the same way, but imports asyncio
            self._check_admitted(*struct.unpack("=Hi", self._events.recv_multipart()[0]))
            lost = True
        if lost:
            raise ConnectionLost(f"the connection to {self.endpoint} ended")

    def _check_admitted(self, event: int, value: int) -> None:
        """Raise an error if the server has refused this client for good, so that trying again is useless."""
        if event == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
            self.close()
            raise SessionError(
                f"the server at {self.endpoint} does not admit this key",
                code="UNAUTHENTICATED",
                hint="its operator admits a key with `mesh-motion keys allow`",
            )
        if event == zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL and value == zmq.PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH:
            self.close()
            raise SessionError(
                f"the server at {self.endpoint} and this client do not agree about the use of keys",
                code="UNAUTHENTICATED",
                hint="give keys only for a server that was started with --keys",
            )

    @property
    def closed(self) -> bool:
        """Whether the connection is closed, by its user or after an error that ends it."""
        return bool(self._socket.closed)

    def close(self) -> None:
        """Close the socket; idempotent. In a forked child the parent's socket stays open."""
        if not self._socket.closed:
            if self._process == os.getpid():
                self._socket.disable_monitor()
            self._events.close()
            self._socket.close()


def check_process(process: int) -> None:
    """Check that this process made the connection: a forked child has none of the threads that serve it.

    Raises
    ------
    SessionError
    """
    if os.getpid() != process:
        raise SessionError(
            f"a forked child cannot use the connections of its parent (process {process})",
            code="FAILED_PRECONDITION",
            hint="connect in the child, and resume the session there with server.resume(session.credentials)",
        )


@contextmanager
def turn(lock: threading.RLock, deadline: float) -> Iterator[None]:
    """Hold the lock in the block: two threads in one socket would take each other's replies, and wait for ever.

    Raises
    ------
    Timeout
    """
    if not lock.acquire(timeout=min(seconds_left(deadline), threading.TIMEOUT_MAX)):
        raise Timeout("another thread's request was not answered within the time allowed")
    try:
        yield
    finally:
        lock.release()


def seconds_left(deadline: float) -> float:
    """Seconds until ``deadline`` on the monotonic clock, 0 if it has passed."""
    return max(0.0, deadline - time.monotonic())


def _sockets() -> tuple[zmq.Socket[bytes], zmq.Socket[bytes]]:
    """Return a socket, and one with the events of its connection. Raises Unavailable if the system gives none."""
    made: list[zmq.Socket[bytes]] = []
    try:
        made.append(zmq.Context.instance().socket(zmq.DEALER))
        made[0].setsockopt(zmq.LINGER, 0)  # an unsent request of a closed connection is worthless
        for option in (zmq.SNDTIMEO, zmq.RCVTIMEO):
            made[0].setsockopt(option, _MOST_MILLISECONDS)
        made.append(made[0].get_monitor_socket(_WATCHED))
    except zmq.ZMQError as error:
        for socket in made:
            socket.close()
        hint = way_out_of(OSError(error.errno, error.strerror), "end other programs that use the network")
        raise Unavailable(f"no socket can be made: {error.strerror}", hint=hint) from error
    return made[0], made[1]


def _no_endpoint(text: object) -> InvalidInput:
    """Return the error for a wrong endpoint, with a guess of the right one."""
    given = str(text)
    rest, _, port = given.rpartition(":")
    if given.startswith("/"):
        hint = f"ipc://{given} is the socket of that path"
    elif port.isdecimal() and not 1 <= int(port) <= _LAST_PORT:
        hint = f"ports are 1 to {_LAST_PORT}"
    elif port.isdecimal():
        hint = f"tcp://{rest.rpartition('/')[2] or '127.0.0.1'}:{port} is that port"
    else:
        hint = "a server writes its endpoint when it is ready: `ready tcp://127.0.0.1:7440`"
    return InvalidInput(f"endpoint must be tcp://HOST:PORT or ipc:///path, got {text!r}", hint=hint)
