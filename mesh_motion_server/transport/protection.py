"""CURVE on a server's sockets: the server's key, who authenticates, and whose message a message is.

Each context asks its own ``inproc://zeromq.zap.01`` about every handshake. In the gateway that is the
:class:`~.authenticator.Authenticator`; a worker, whose interpreter may compute for minutes, passes the questions on to
the gateway from a thread that runs in libzmq and needs no interpreter (:func:`forward_handshakes`).

``ZAP_ENFORCE_DOMAIN`` makes libzmq refuse a handshake that nobody answers; without it a context that has no handler
lets everybody in.
"""

from __future__ import annotations

import contextlib
import resource
import threading
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import zmq
from mesh_motion_protocol.key_files import KeyFileError, SecretKey

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.security.allow_list import Access, AllowList, Everybody
from mesh_motion_server.security.key_folder import ALLOW_LIST, SERVER, read_list, require_curve
from mesh_motion_server.transport.endpoints import EndpointError

__all__ = [
    "HANDLER",
    "Protection",
    "forward_handshakes",
    "keep_secrets_out_of_core_files",
    "user_of",
]

#: Where libzmq asks, in every context.
HANDLER = "inproc://zeromq.zap.01"
#: What CURVE puts around a frame: command name, nonce, authenticator, flags.
_CURVE_BYTES = 33
_DOMAIN = b"mesh-motion"


@dataclass(frozen=True)
class Protection:
    """What a process needs to protect its sockets; travels over channels, never on command lines.

    Attributes
    ----------
    secret : str
        The server's secret key, Z85.
    allow_list : str
        Path of the allow-list.
    handshakes : str
        The gateway's ipc endpoint where workers ask about handshakes.
    """

    secret: str = field(repr=False)
    allow_list: str
    handshakes: str = ""

    @classmethod
    def of_folder(cls, folder: Path) -> Protection:
        """The keys that ``mesh-motion keys server`` made.

        Raises
        ------
        EndpointError
            If CURVE, a key or the allow-list is missing, wrong, or open to others.
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
        """What the supervisor has sent, None for a server without keys."""
        values = order.get("protection")
        return cls(**values) if values else None

    def to_order(self) -> dict[str, str]:
        """For a channel."""
        return asdict(self)

    @staticmethod
    def access(protection: Protection | None) -> Access:
        """Who has which role on a server protected so."""
        return Everybody() if protection is None else AllowList(Path(protection.allow_list))

    def protect(self, socket: zmq.Socket[bytes]) -> None:
        """Make a socket, which has its MAXMSGSIZE, a CURVE server whose handshakes are refused unless allowed."""
        socket.setsockopt(zmq.CURVE_SERVER, 1)
        socket.setsockopt(zmq.CURVE_SECRETKEY, self.secret.encode())
        socket.setsockopt(zmq.ZAP_DOMAIN, _DOMAIN)
        socket.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)
        socket.setsockopt(zmq.MAXMSGSIZE, int(socket.getsockopt(zmq.MAXMSGSIZE)) + _CURVE_BYTES)


def user_of(frame: zmq.Frame, protection: Protection | None) -> str:
    """The public key that a message came under, ``""`` on a server without keys.

    There the peer itself says what the message's ``User-Id`` is, so it is not looked at.
    """
    if protection is None:
        return ""
    with contextlib.suppress(zmq.ZMQError):
        return str(frame.get("User-Id"))
    return "?"


def forward_handshakes(context: zmq.Context[zmq.Socket[bytes]], handshakes: str) -> threading.Thread:
    """Pass this context's handshakes on to the gateway, until the context ends.

    If the gateway is away, handshakes are not answered and fail; it comes back on the same endpoint.
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
    """A process that crashes with the server's key in its memory leaves no core file."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
