"""A session for the cases: correct requests for its present state, and ways to reach a state."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_conformance.case import Unmet, require
from mesh_motion_conformance.checks import answered
from mesh_motion_conformance.line import Ended, Line, Silence
from mesh_motion_conformance.server.mesh import SQUARE, Part
from mesh_motion_conformance.server.requests import Header, Request
from mesh_motion_conformance.show import show
from mesh_motion_conformance.tables import tables
from mesh_motion_conformance.wire import Malformed, Message

if TYPE_CHECKING:
    from mesh_motion_conformance.server.stage import Stage

__all__ = ["Session", "data_endpoint"]

#: Requests that compute or start a process.
_LONG = ("BUILD", "MOVE", "TANGENT", "COTANGENT", "JUDGE", "CORRECT", "COMMIT")


def data_endpoint(control: str, data: str) -> str:
    """SPEC 2.3: a wildcard host means the host of the control endpoint."""
    host, _, port = data.removeprefix("tcp://").rpartition(":")
    if data.startswith("tcp://") and host in ("0.0.0.0", "[::]"):
        return f"{control.rpartition(':')[0]}:{port}"
    return data


class Session:
    """One session and a connection for each of its partitions.

    Parameters
    ----------
    opened : Message
        OPENED.
    parts : tuple of Part
        The mesh, by partition.

    Attributes
    ----------
    id, token, endpoint, epoch
        As in OPENED, or as in the last RESUMED.
    opened, built : Message
        OPENED, and BUILT once it came.
    lines : list of Line
        By partition.
    step : int
        The last committed step that this object knows.
    """

    def __init__(self, stage: Stage, opened: Message, parts: tuple[Part, ...]) -> None:
        self.stage, self.parts = stage, parts
        self.id: str = opened.fields["session"]
        self.token: bytes = opened.fields["token"]
        self.endpoint: str = opened.fields["endpoint"]
        self.epoch: int = opened.fields["epoch"]
        self.opened = opened
        self.lines: list[Line] = []
        self.step = 0
        self.built: Message | None = None

    # --- requests ----------------------------------------------------------------------------------------------------

    def address(self, partition: int = 0) -> dict[str, Any]:
        """The fields that all requests to the session share."""
        return {"session": self.id, "epoch": self.epoch} | ({"partition": partition} if partition else {})

    def request(self, kind: str, partition: int = 0) -> Request:
        """A correct request of this kind, for a state that accepts it."""
        at = self.address(partition)
        if kind in ("RESUME", "PROBE"):
            return Request(kind, {"session": self.id, "token": self.token})
        if kind == "UPLOAD":
            fields, rows = list(self.parts[partition].uploads())[-1]
            return Request(kind, at | fields, {"rows": rows[:1]})
        if kind == "MOVE":
            frame = "committed" if self.parts[partition].triangles.size else "reference"
            fields = at | {"step": self.step + 1, "frame": frame}
            return Request(kind, fields, {"displacement": self.rows(partition)})
        if kind in ("TANGENT", "COTANGENT"):
            part, rows = self.parts[partition], self.rows(partition)
            return Request(kind, at, {"velocity": rows} if kind == "TANGENT" else {"weights": part.points})
        if kind in ("JUDGE", "CORRECT"):
            return self.judge() if kind == "JUDGE" else self.correct()
        own: dict[str, Any] = {"JOIN": {"token": self.token}}
        own |= {name: {"step": self.step + 1} for name in ("COMMIT", "ROLLBACK")}
        own |= {name: {} for name in ("BUILD", "FETCH", "STATUS", "CLOSE")}
        return Request(kind, at | own[kind] if kind in own else {})

    def judge(self, lowest: float = 0.5, metrics: tuple[str, ...] = ("size", "skew", "size-skew")) -> Request:
        """A JUDGE of a single partition whose cells all have the same quality, with the bins of these metrics."""
        cells, numbers = len(self.parts[0].triangles), range(len(metrics))
        minima = dict.fromkeys(("size", "skew", "size-skew"), lowest)
        sums = {name: cells * value for name, value in minima.items()}
        fields = {
            "step": self.step + 1,
            "part": {"cells": cells, "inverted": 0 if lowest > 0.0 else cells, "sums": sums, "minima": minima},
            "questions": [{"metric": name, "way": []} for name in metrics],
        }
        bins = [[number, int((lowest + 1.0) * 1024), cells] for number in numbers]
        worst = [[1, cell, lowest, lowest, lowest, lowest, 0.0, 0.0] for cell in range(10)]
        arrays = {
            "bins": np.array(bins, dtype="<i8").reshape(-1, 3),
            "values": np.array([[number, lowest, cells] for number in numbers], dtype="<f8").reshape(-1, 3),
            "worst": np.array(worst, dtype="<f8"),
        }
        return Request("JUDGE", self.address() | fields, arrays)

    def correct(self, below: float = 0.5, interior: int = 0, least: tuple[float, float] = (1.0, 1.0)) -> Request:
        """A CORRECT of a single partition with all of its cells and all nodes at rest."""
        part, points = self.parts[0], SQUARE.points
        described = {"metric": "size-skew", "below": below, "rings": 4, "interior": interior, "least": list(least)}
        fields = {"step": self.step + 1, "part": described | {"cells": {"triangle": len(part.triangles)}}}
        arrays = {
            "nodes": np.array([[node, 1] for node in range(len(points))], dtype="<i8"),
            "points": points,
            "positions": points,
            "corners": SQUARE.triangles.reshape(-1, 1).astype("<i8"),
        }
        return Request("CORRECT", self.address() | fields, arrays)

    def rows(self, partition: int = 0, size: float = 0.01) -> NDArray[np.float64]:
        """(k, d) displacement of a partition's moving nodes: a shift that float64 cannot represent exactly."""
        part = self.parts[partition]
        shift = np.array([size / 3, size, size / 7])[: part.points.shape[1]]
        return np.tile(shift, (len(part.moving), 1))

    def ask(
        self,
        request: Request | str,
        partition: int = 0,
        *,
        sequence: int | None = None,
        client: bytes | None = None,
        change: Callable[[Header], Any] | None = None,
    ) -> Message:
        """Send a request, or a correct one of this kind, on the partition's connection and return the reply."""
        right = self.request(request, partition) if isinstance(request, str) else request
        seconds = self.stage.opening_seconds if right.kind in _LONG else None
        return self.stage.ask(
            right, self.lines[partition], sequence=sequence, client=client, change=change, seconds=seconds
        )

    def do(self, request: Request | str, partition: int = 0, **fields: Any) -> Message:
        """Send a request and check that the reply is that of the table, with these values in its fields."""
        kind = request if isinstance(request, str) else request.kind
        reply = answered(self.ask(request, partition), tables().requests[kind]["reply"], **fields)
        if kind == "COMMIT":
            self.step = reply.fields["step"]
        elif kind == "BUILD":
            self.built = reply
        return reply

    # --- its life ----------------------------------------------------------------------------------------------------

    def connect(self) -> Line:
        """A connection to the data endpoint that has not joined."""
        return self.stage.line(data_endpoint(self.stage.endpoint, self.endpoint))

    def join(self) -> list[Message]:
        """New connections for all partitions; JOINED of each."""
        for line in self.lines:
            line.close()
        self.lines = [self.connect() for _ in self.parts]
        joined = [self.do("JOIN", partition) for partition in range(len(self.parts))]
        self.step = joined[0].fields["step"]
        return joined

    def resume(self) -> Message:
        """Resume the session, under the next epoch."""
        reply = answered(self.stage.ask(self.request("RESUME"), seconds=self.stage.opening_seconds), "RESUMED")
        self.endpoint, self.epoch = reply.fields["endpoint"], reply.fields["epoch"]
        self.step = reply.fields["step"]
        return reply

    def about(self, kind: str, arrays: dict[str, NDArray[Any]] | None = None, **fields: Any) -> Request:
        """A request of the first partition with these fields and arrays, and no others."""
        return Request(kind, self.address() | fields, arrays or {})

    def uploading(self, rows: Any, item: str, **fields: str) -> Request:
        """An UPLOAD of the first partition."""
        return self.about("UPLOAD", {"rows": np.asarray(rows)}, item=item, **fields)

    def upload(self) -> None:
        """The whole mesh."""
        for partition, part in enumerate(self.parts):
            for fields, rows in part.uploads():
                self.do(Request("UPLOAD", self.address(partition) | fields, {"rows": rows}), partition)

    def build(self) -> Message:
        """BUILT of the whole mesh."""
        self.upload()
        return self.do("BUILD")

    def step_on(self) -> Message:
        """COMMITTED of one move."""
        self.do("MOVE")
        return self.do("COMMIT")

    def take_up(self) -> list[Message]:
        """Resume the session and join it again; JOINED of each partition."""
        self.resume()
        return self.join()

    def send(self, request: Request, partition: int = 0) -> int:
        """Send a request without waiting for the reply; return its number."""
        line = self.lines[partition]
        number = line.next()
        self.stage.put(line, request.frames(line.client, number))
        return number

    def receive(self, number: int, partition: int = 0) -> Message:
        """The reply to the request of this number."""
        reply = self.lines[partition].receive(self.stage.opening_seconds)
        wanted = self.lines[partition].client, number
        require((reply.client, reply.sequence) == wanted, f"the reply to request {number}", show(reply))
        return reply

    def together(self, *requests: Request | str) -> list[Message]:
        """One request of each partition, all sent before any reply is read; a single kind is of every partition."""
        every = requests if len(requests) > 1 else requests * len(self.lines)
        made = [self.request(r, number) if isinstance(r, str) else r for number, r in enumerate(every)]
        numbers = [self.send(request, partition) for partition, request in enumerate(made)]
        return [self.receive(number, partition) for partition, number in enumerate(numbers)]

    def status(self) -> dict[str, Any]:
        """STATUS_REPORT's fields."""
        return self.do("STATUS").fields

    def reach(self, state: str) -> Session:
        """Bring the session into this state, from any state from which it can be reached."""
        for _ in range(4):
            now = self._look()
            self.step = now["step"]
            if now["state"] == state:
                return self
            self._towards(state, now["state"])
        raise Unmet(f"a session in state {state}", f"state {now['state']}")

    def _look(self) -> dict[str, Any]:
        """STATUS of the session; join again if the connection or the epoch is lost."""
        try:
            return self.status()
        except (Unmet, Silence, Ended, Malformed):
            self.take_up()
            return self.status()

    def _towards(self, state: str, now: str) -> None:
        """One step on the way."""
        if now == "NEW" and state != "NEW":
            self.upload()
        elif now == "OPENING":
            self.built, *_ = [answered(reply, "BUILT") for reply in self.together("BUILD")]
        elif now == "READY" and state == "TRIAL":
            self.do("MOVE")
        elif now == "TRIAL":
            self.do("ROLLBACK")
        elif now == "SUSPENDED":
            self.join()
        else:
            raise Unmet(f"a session in state {state}", f"state {now}")

    def discard(self) -> None:
        """Discard the session, if the server allows it."""
        for partition, line in enumerate(self.lines):
            with contextlib.suppress(Exception):
                if not line.closed:
                    self.stage.ask(self.request("CLOSE", partition).having(outcome="discard"), line, seconds=2.0)
            line.close()
