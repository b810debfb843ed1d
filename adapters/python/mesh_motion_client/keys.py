"""The keys for a server that requires them: the client's own key, and the server's public key."""

from __future__ import annotations

import os
from dataclasses import dataclass, field

import zmq
from mesh_motion_protocol.errors import InvalidInput
from mesh_motion_protocol.key_files import KeyFileError, PublicKey, SecretKey, checked_key

__all__ = ["KEY_VARIABLE", "SERVER_KEY_VARIABLE", "Keys"]

#: Environment variables: a file with the client's secret key; a file with the server's public key, or the key itself.
KEY_VARIABLE, SERVER_KEY_VARIABLE = "MESH_MOTION_KEY", "MESH_MOTION_SERVER_KEY"

Path = str | os.PathLike[str]


@dataclass(frozen=True)
class Keys:
    """The client's secret key, and the public key of the server that it accepts.

    Attributes
    ----------
    name : str
        Name of the key's owner.
    secret : str
        The client's secret key, Z85. It proves who the client is.
    server : str
        The server's public key, Z85.
    """

    name: str
    secret: str = field(repr=False)
    server: str

    @classmethod
    def load(cls, key: Path, server_key: Path) -> Keys:
        """Read a ``.secret`` and the server's ``.public`` file, as ``mesh-motion keys`` makes them.

        Parameters
        ----------
        key : path
        server_key : path or str
            The file, or the key's 40 characters themselves.

        Raises
        ------
        InvalidInput
            If one holds no key, or others may read the secret one.
        """
        try:
            own = SecretKey.load(key)
            return cls(own.name, own.key, _server_key(server_key))
        except KeyFileError as error:
            raise InvalidInput(str(error)) from None

    @classmethod
    def from_environment(cls) -> Keys | None:
        """Read the keys that ``MESH_MOTION_KEY`` and ``MESH_MOTION_SERVER_KEY`` name; None if neither is set.

        Raises
        ------
        InvalidInput
            If only one is set, or as :meth:`load`.
        """
        key, server_key = os.environ.get(KEY_VARIABLE, ""), os.environ.get(SERVER_KEY_VARIABLE, "")
        if not key and not server_key:
            return None
        if not key or not server_key:
            raise InvalidInput(f"{KEY_VARIABLE} and {SERVER_KEY_VARIABLE} must be set both, or neither")
        return cls.load(key, server_key)

    def protect(self, socket: zmq.Socket[bytes]) -> None:
        """Make a socket a CURVE client.

        Raises
        ------
        InvalidInput
            If libzmq was built without CURVE.
        """
        if not zmq.has("curve"):
            raise InvalidInput(
                f"keys need CURVE, but libzmq {zmq.zmq_version()} was built without it",
                hint="install pyzmq from its wheel, or a libzmq with libsodium",
            )
        socket.setsockopt(zmq.CURVE_SERVERKEY, self.server.encode())
        socket.setsockopt(zmq.CURVE_PUBLICKEY, zmq.curve_public(self.secret.encode()))
        socket.setsockopt(zmq.CURVE_SECRETKEY, self.secret.encode())


def _server_key(text: Path) -> str:
    """The key in a file; the text itself if it is a key and not a file."""
    if isinstance(text, str) and len(text) == 40 and not os.path.exists(text):
        return checked_key(text)
    return PublicKey.load(text).key
