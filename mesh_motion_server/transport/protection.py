"""CURVE on a server's sockets: the server's key, the authenticator, the key of each message and its rights.

Each context asks its own ``inproc://zeromq.zap.01`` about every handshake. In the gateway this is the
:class:`~.authenticator.Authenticator`. A worker, whose interpreter may compute for minutes, passes the requests on to
the gateway from a thread of libzmq that needs no interpreter (:func:`forward_handshakes`).

``ZAP_ENFORCE_DOMAIN`` makes libzmq refuse a handshake without an answer; without it a context without a handler admits
every client.
"""

from __future__ import annotations

import contextlib
import resource
import threading
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import zmq
from mesh_motion_protocol.errors import InvalidInput
from mesh_motion_protocol.key_files import KeyFileError, SecretKey
from mesh_motion_protocol.messages import Message

from mesh_motion_server.security.allow_list import Access, AllowList, Everybody
from mesh_motion_server.security.authorisation import Verdict, decide, refusal
from mesh_motion_server.security.key_folder import ALLOW_LIST, SERVER, read_list, require_curve
from mesh_motion_server.transport.endpoints import EndpointError

#: The address that libzmq asks, in every context.
HANDLER = "inproc://zeromq.zap.01"
#: Bytes that CURVE adds to a frame: command name, nonce, authenticator, flags.
_CURVE_BYTES = 33
_DOMAIN = b"mesh-motion"


@dataclass(frozen=True)
class Protection:
    """The data with which a process protects its sockets; sent over channels, never on command lines."""

    secret: str = field(repr=False)  # the server's secret key, Z85
    allow_list: str  # path of the allow-list
    handshakes: str = ""  # the gateway's ipc endpoint for handshake requests of workers

    @classmethod
    def of_folder(cls, folder: Path) -> Protection:
        """Read the keys that ``mesh-motion keys server`` made.

        Raises EndpointError if CURVE, a key or the allow-list is missing, wrong, or open to others.
        """
        try:
            require_curve()
            secret = SecretKey.load(folder / f"{SERVER}.secret").key
            read_list(folder)
        except KeyFileError as error:
            raise EndpointError(str(error), hint=f"`mesh-motion keys server {folder}` makes keys") from None
        except InvalidInput as error:
            raise EndpointError(error.message, hint=error.hint) from None
        return cls(secret, str(folder.absolute() / ALLOW_LIST))

    @classmethod
    def of_order(cls, order: dict[str, Any]) -> Protection | None:
        """Return the protection that the supervisor has sent; None for a server without keys."""
        values = order.get("protection")
        return cls(**values) if values else None

    def to_order(self) -> dict[str, str]:
        """Return the values to send over a channel."""
        return asdict(self)

    @staticmethod
    def access(protection: Protection | None) -> Access:
        """Return the access rights of a server with this protection."""
        return Everybody() if protection is None else AllowList(Path(protection.allow_list))

    def protect(self, socket: zmq.Socket[bytes]) -> None:
        """Make a socket a CURVE server that refuses handshakes unless allowed; its MAXMSGSIZE is already set."""
        socket.setsockopt(zmq.CURVE_SERVER, 1)
        socket.setsockopt(zmq.CURVE_SECRETKEY, self.secret.encode())
        socket.setsockopt(zmq.ZAP_DOMAIN, _DOMAIN)
        socket.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)
        socket.setsockopt(zmq.MAXMSGSIZE, int(socket.getsockopt(zmq.MAXMSGSIZE)) + _CURVE_BYTES)


def user_of(frame: zmq.Frame, protection: Protection | None) -> str:
    """Return the public key of a message's connection, ``""`` on a server without keys.

    Without keys the peer itself sets the message's ``User-Id``, so it is ignored.
    """
    if protection is None:
        return ""
    with contextlib.suppress(zmq.ZMQError):
        return str(frame.get("User-Id"))
    return "?"


def forward_handshakes(context: zmq.Context[zmq.Socket[bytes]], handshakes: str) -> threading.Thread:
    """Pass this context's handshakes on to the gateway, until the context ends.

    While the gateway is away, handshakes get no answer and fail; it restarts on the same endpoint.
    """
    questions, gateway = context.socket(zmq.ROUTER), context.socket(zmq.DEALER)
    for socket in (questions, gateway):
        socket.setsockopt(zmq.LINGER, 0)
    questions.bind(HANDLER)
    gateway.connect(handshakes)

    def run() -> None:
        with contextlib.suppress(zmq.ContextTerminated):
            zmq.proxy(questions, gateway)
        questions.close()
        gateway.close()

    thread = threading.Thread(target=run, name="handshakes", daemon=True)
    thread.start()
    return thread


def keep_secrets_out_of_core_files() -> None:
    """Disable core files, so that a crash does not write the server's key to disk."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


class Rights:
    """The allow-list and the session's owner, checked at every request.

    Parameters
    ----------
    protection : Protection or None
        None: a server without keys, where everybody is the owner.
    owner : str
        The public key of the user who opened the session.
    """

    def __init__(self, protection: Protection | None, owner: str) -> None:
        self._protection = protection
        self._access = Protection.access(protection)
        self._owner = owner

    def user(self, frame: zmq.Frame) -> str:
        """Return the public key of the message's connection."""
        return user_of(frame, self._protection)

    def is_owner(self, user: str) -> bool:
        """Whether this user owns the session."""
        return user == self._owner

    def check(self, user: str, request: Message) -> Verdict:
        """Return USE or OVERSEE.

        Raises SessionError: UNAUTHENTICATED for a key removed from the list, NOT_FOUND or PERMISSION_DENIED according
        to the table, UNAVAILABLE while the allow-list cannot be used.
        """
        verdict = decide(self._access.roles(user), request.type, own=self.is_owner(user))
        if verdict not in (Verdict.USE, Verdict.OVERSEE):
            raise refusal(verdict, request.type, getattr(request, "session", ""))
        return verdict
