"""The control endpoint as a client sees it: HELLO, OPEN, RESUME, LIST, PROBE, asked until they are answered."""

from __future__ import annotations

import time
import uuid
from typing import Any, TypeVar

from mesh_motion_protocol.messages import Message

from mesh_motion_client.connection import Connection, ConnectionLost, seconds_left
from mesh_motion_client.errors import Unavailable
from mesh_motion_client.keys import Keys

__all__ = ["Control"]

_Reply = TypeVar("_Reply", bound=Message)

#: Between two tries while nobody can answer, seconds.
_PAUSE_SECONDS = 0.2


class Control:
    """Asks the control endpoint; a request that is repeated executes once.

    Parameters
    ----------
    endpoint : str
    keys : Keys, optional
        For a server that asks for them.
    """

    def __init__(self, endpoint: str, keys: Keys | None = None) -> None:
        self.endpoint = endpoint
        self._keys = keys
        self._client = uuid.uuid4().bytes
        self._sequence = 0
        self._connection: Connection | None = None

    def ask(self, kind: type[Message], expected: type[_Reply], seconds: float, **fields: Any) -> _Reply:
        """Send a request of this kind until it is answered or the time is over.

        Raises
        ------
        Timeout, Unavailable, MeshMotionError
        """
        deadline = time.monotonic() + seconds
        self._sequence += 1
        message = kind(client=self._client, sequence=self._sequence, **fields)
        while True:
            try:
                reply = self._connected().request(message, deadline)
            except Unavailable as error:
                if isinstance(error, ConnectionLost):
                    self.close()
                if seconds_left(deadline) <= _PAUSE_SECONDS:
                    raise
                time.sleep(_PAUSE_SECONDS)
                continue
            if not isinstance(reply, expected):
                raise TypeError(f"{kind.type} is answered by {reply.type}, not {expected.type}")
            return reply

    def _connected(self) -> Connection:
        if self._connection is None:
            self._connection = Connection(self.endpoint, self._keys)
        return self._connection

    def data_connection(self, endpoint: str) -> Connection:
        """A connection to a session's worker, with the same keys."""
        return Connection(self.data_endpoint(endpoint), self._keys)

    def data_endpoint(self, endpoint: str) -> str:
        """A data endpoint as reached from here: a wildcard address stands for the host of the control endpoint."""
        host, _, port = endpoint.removeprefix("tcp://").rpartition(":")
        if endpoint.startswith("tcp://") and host in ("0.0.0.0", "[::]", "*"):
            return f"{self.endpoint.rpartition(':')[0]}:{port}"
        return endpoint

    def close(self) -> None:
        """Close the connection; the next request opens another one."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None
