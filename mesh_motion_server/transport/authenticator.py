"""The ZAP handler (ZeroMQ RFC 27): the gateway decides every CURVE handshake of the server here.

Deny by default: only a key that is on the allow-list at this moment gets 200; any error is a refusal. The reply's user
id is the key itself, which libzmq then attaches to each message of the connection.
"""

import contextlib
import time
from collections import Counter

import zmq
from mesh_motion_protocol.errors import SessionError
from zmq.utils import z85

from mesh_motion_server.operation.tally import TALLY
from mesh_motion_server.security.allow_list import AllowList
from mesh_motion_server.transport.protection import HANDLER
from mesh_motion_server.transport.telemetry import log

_ALLOWED, _TEMPORARY, _REFUSED = b"200", b"300", b"400"
#: Frames of a request after the empty delimiter: version, id, domain, address, routing id, mechanism, key.
_FRAMES = 7
#: Enough for any request of libzmq: its longest variable frames are a routing id of 255 bytes and an address.
_QUESTION_BYTES = 4096
#: Refused handshakes are counted and logged at most this often, so that an attack does not fill the log.
_LOG_SECONDS = 1.0


class Authenticator:
    """Answers this context's handshakes and those that workers pass on.

    Parameters
    ----------
    handshakes : str
        ipc endpoint for the workers.

    Attributes
    ----------
    socket : zmq.Socket
        Becomes readable with each handshake request.
    guest : str
        One additional allowed key, for the self-test.
    """

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], allow_list: AllowList, handshakes: str) -> None:
        self.socket = context.socket(zmq.ROUTER)
        self.socket.setsockopt(zmq.MAXMSGSIZE, _QUESTION_BYTES)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.bind(HANDLER)
        self.socket.bind(handshakes)
        self.guest = ""
        self._allow_list = allow_list
        self._counts: Counter[str] = Counter()
        self._logged = (0.0, 0)

    def answer_waiting(self) -> None:
        """Answer one handshake request if one is waiting."""
        if self.socket.poll(0):
            self.answer()

    def answer(self) -> None:
        """Receive one handshake request and answer it."""
        frames = self.socket.recv_multipart()
        if b"" not in frames:
            return
        start = frames.index(b"") + 1
        path, question = frames[:start], frames[start:]
        if len(question) < 2:
            return
        status, text, user = self._judge(question)
        self._count(status)
        with contextlib.suppress(zmq.ZMQError):  # the socket that asked is gone: the handshake then fails
            self.socket.send_multipart([*path, b"1.0", question[1], status, text, user, b""], flags=zmq.NOBLOCK)

    def _judge(self, question: list[bytes]) -> tuple[bytes, bytes, bytes]:
        """Return status, text and user id for one handshake."""
        if len(question) != _FRAMES or question[0] != b"1.0" or question[5] != b"CURVE" or len(question[6]) != 32:
            return _REFUSED, b"only CURVE is admitted", b""
        key = z85.encode(question[6])
        if self.guest and key == self.guest.encode():
            return _ALLOWED, b"OK", key
        try:
            admitted = self._allow_list.entry(key.decode()) is not None
        except SessionError:
            return _TEMPORARY, b"the allow-list cannot be used", b""
        except Exception:
            log().exception("handshake_failed")
            return _REFUSED, b"not decided", b""
        return (_ALLOWED, b"OK", key) if admitted else (_REFUSED, b"not on the allow-list", b"")

    def _count(self, status: bytes) -> None:
        self._counts[status.decode()] += 1
        if status != _ALLOWED:
            TALLY.count("denied_connections")
        refused = self._counts.total() - self._counts[_ALLOWED.decode()]
        when, logged = self._logged
        if refused > logged and time.monotonic() - when > _LOG_SECONDS:
            self._logged = (time.monotonic(), refused)
            log().warning("handshakes_refused", refused=refused, allowed=self._counts[_ALLOWED.decode()])

    def close(self) -> None:
        """Close the socket: from now on every handshake of this context is refused."""
        self.socket.close()
