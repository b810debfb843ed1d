"""A server that follows a script: correct, except for the disturbances of the script.

One thread, a ROUTER for the control endpoint and one for the data endpoint. Everything that arrives is noted.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import zmq

from mesh_motion_conformance.client.actions import ACTIONS, Arrival
from mesh_motion_conformance.client.requests_check import offences
from mesh_motion_conformance.client.scripted_session import SESSION, TOKEN, Reply, ScriptedSession, error
from mesh_motion_conformance.tables import tables
from mesh_motion_conformance.wire import Malformed, Message, declaration, frames_of, pack, read

__all__ = ["Disturbance", "ScriptedServer", "Seen"]

#: No call of a socket lasts longer.
_MOST_MILLISECONDS = 60_000


@dataclass(frozen=True)
class Disturbance:
    """A disturbance of the ``nth`` to ``nth + times - 1`` arrival of a request: a key of :data:`ACTIONS`."""

    request: str
    action: str
    nth: int = 1
    times: int = 1
    given: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Seen:
    """A request that arrived, with its endpoint and its faults."""

    message: Message
    endpoint: str
    wrong: tuple[str, ...]


class ScriptedServer:
    """Runs from construction to :meth:`close`; ``welcome``: fields of WELCOME that differ from a plain server's."""

    def __init__(self, disturbances: list[Disturbance], welcome: dict[str, Any]) -> None:
        self.session = ScriptedSession()
        self.seen: list[Seen] = []
        self.broken: list[str] = []
        self.worker = "none"
        self._disturbances = disturbances
        self._welcome = welcome
        self._arrivals: Counter[str] = Counter()
        self._joined: set[bytes] = set()
        self._control_replies: dict[tuple[bytes, int], Reply] = {}
        self._delayed: list[tuple[float, zmq.Socket[bytes], list[bytes]]] = []
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._control = self._router()
        self.endpoint = _bound(self._control, "tcp://127.0.0.1:*")
        self._data: zmq.Socket[bytes] | None = None
        self._data_endpoint = ""
        self._over = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and both sockets."""
        self._over = True
        self._thread.join()
        self._control.close(0)
        self.close_data()
        self._context.term()

    # --- the loop ----------------------------------------------------------------------------------------------------

    def _router(self) -> zmq.Socket[bytes]:
        socket = self._context.socket(zmq.ROUTER)
        socket.setsockopt(zmq.LINGER, 0)
        for option in (zmq.SNDTIMEO, zmq.RCVTIMEO):
            socket.setsockopt(option, _MOST_MILLISECONDS)
        return socket

    def _run(self) -> None:
        while not self._over:
            poller = zmq.Poller()
            poller.register(self._control, zmq.POLLIN)
            if self._data is not None:
                poller.register(self._data, zmq.POLLIN)
            for socket, _ in poller.poll(20):
                if socket in (self._control, self._data):
                    self._receive(socket)
            now = time.monotonic()
            for entry in [entry for entry in self._delayed if entry[0] <= now]:
                self._delayed.remove(entry)
                self._put(entry[1], entry[2])

    def _receive(self, socket: zmq.Socket[bytes]) -> None:
        peer, *frames = socket.recv_multipart()
        endpoint = "control" if socket is self._control else "data"
        try:
            request = read(frames)
        except Malformed as malformed:
            self.broken.append(str(malformed))
            return
        if endpoint == "data" and request.kind == "JOIN":
            self._joined.add(peer)
        elif endpoint == "data" and request.kind != "PING" and peer not in self._joined:
            refusal = error("UNAUTHENTICATED", self.session.state, partition=0)
            self.put(socket, peer, self.frames(request, refusal))
            return
        self.seen.append(Seen(request, endpoint, tuple(offences(request))))
        self._arrivals[request.kind] += 1
        disturbance = self._disturbance(request.kind)
        arrival = Arrival(self, socket, peer, request, disturbance.given if disturbance else {})
        if disturbance is None:
            arrival.send(self.execute(request, endpoint))
        else:
            ACTIONS[disturbance.action](arrival)

    def _disturbance(self, kind: str) -> Disturbance | None:
        count = self._arrivals[kind]
        fitting = (d for d in self._disturbances if d.request == kind and d.nth <= count < d.nth + d.times)
        return next(fitting, None)

    # --- what actions use --------------------------------------------------------------------------------------------

    def execute(self, request: Message, endpoint: str) -> Reply:
        """The answer of an undisturbed server."""
        if request.kind == "PING":
            return Reply("PONG", {})
        if tables().requests.get(request.kind, {}).get("endpoint") != endpoint:
            return error("UNIMPLEMENTED.MESSAGE")
        if endpoint == "data":
            if request.fields["session"] != SESSION or request.fields.get("token", TOKEN) != TOKEN:
                return error("NOT_FOUND")
            return self.session.answer(request)
        key = request.client, request.sequence
        if key not in self._control_replies or request.kind not in ("OPEN", "RESUME"):
            self._control_replies[key] = self._answer_control(request)
        return self._control_replies[key]

    def _answer_control(self, request: Message) -> Reply:
        if request.kind == "HELLO":
            fields: dict[str, Any] = {"version": [1, 0], "features": [], "server": "scripted", "boot": bytes(16)}
            limits = {name: row["value"] for name, row in tables().limits.items()}
            return Reply("WELCOME", fields | {"limits": limits, "durability": ["full"]} | self._welcome)
        if request.kind == "LIST":
            return Reply("LISTED", {"sessions": [], "more": False})
        if request.kind == "OPEN":
            self.start_data()
            fields = {"session": SESSION, "token": TOKEN, "endpoint": self._data_endpoint, "epoch": 1}
            return Reply("OPENED", fields)
        if (request.fields["session"], request.fields["token"]) != (SESSION, TOKEN):
            return error("NOT_FOUND")
        if request.kind == "PROBE":
            alive = self.worker == "alive"
            fields = {"session": SESSION, "worker": self.worker, "epoch": self.session.epoch if alive else 0}
            return Reply("PROBED", fields | {"endpoint": self._data_endpoint if alive else ""})
        if self.worker != "alive":
            self.session.lose_worker()
            self.start_data()
        resumed = self.session.resume()
        resumed.fields["endpoint"] = self._data_endpoint
        return resumed

    def start_data(self) -> None:
        """A worker: a data endpoint on its own port."""
        if self._data is None:
            self._data = self._router()
            self._data_endpoint = _bound(self._data, "tcp://127.0.0.1:*")
        self.worker = "alive"

    def cut_data(self) -> None:
        """End all data connections; the worker listens on the same port again."""
        self.close_data()
        self._data = self._router()
        for _ in range(100):
            try:
                self._data.bind(self._data_endpoint)
                return
            except zmq.ZMQError:
                time.sleep(0.01)

    def close_data(self) -> None:
        """End the data endpoint."""
        if self._data is not None:
            self._data.close(0)
            self._data = None

    def frames(self, request: Message, reply: Reply, **header: Any) -> list[bytes]:
        """A reply's frames; ``header`` overrides keys of frame 0."""
        content = {
            "v": 1,
            "type": reply.kind,
            "client": request.client,
            "sequence": request.sequence,
            "fields": reply.fields,
            "arrays": [declaration(name, array) for name, array in reply.arrays.items()],
        }
        return [pack(content | header), *(frame for array in reply.arrays.values() for frame in frames_of(array))]

    def put(self, socket: zmq.Socket[bytes], peer: bytes, frames: list[bytes], *, after: float = 0.0) -> None:
        """Send frames to a peer, now or later."""
        if after:
            self._delayed.append((time.monotonic() + after, socket, [peer, *frames]))
        else:
            self._put(socket, [peer, *frames])

    def _put(self, socket: zmq.Socket[bytes], frames: list[bytes]) -> None:
        with contextlib.suppress(zmq.ZMQError):  # the peer or the endpoint may be gone
            socket.send_multipart(frames)


def _bound(socket: zmq.Socket[bytes], address: str) -> str:
    socket.bind(address)
    where = socket.getsockopt(zmq.LAST_ENDPOINT)
    return where.rstrip(b"\0").decode() if isinstance(where, bytes) else address
