"""Actions of a script on a request or its reply, by name."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import msgpack
import zmq

from mesh_motion_conformance.client.scripted_session import Reply, error
from mesh_motion_conformance.wire import Message, pack

if TYPE_CHECKING:
    from mesh_motion_conformance.client.scripted_server import ScriptedServer

__all__ = ["ACTIONS", "Arrival"]

#: A reply has left within this, seconds.
_ON_ITS_WAY = 0.1


@dataclass(frozen=True)
class Arrival:
    """A request that has arrived, and the ways in which an action may use it; ``given``: the action's parameters."""

    server: ScriptedServer
    socket: zmq.Socket[bytes]
    peer: bytes
    request: Message
    given: dict[str, Any]

    def executed(self) -> Reply:
        """The answer of an undisturbed server."""
        endpoint = "control" if self.request.kind in ("HELLO", "OPEN", "RESUME", "LIST", "PROBE") else "data"
        return self.server.execute(self.request, endpoint)

    def send(self, reply: Reply, after: float = 0.0, **header: Any) -> None:
        """Send a reply, now or later; ``header`` overrides keys of frame 0."""
        self.put(self.server.frames(self.request, reply, **header), after)

    def put(self, frames: list[bytes], after: float = 0.0) -> None:
        """Send frames to the peer, now or later."""
        self.server.put(self.socket, self.peer, frames, after=after)


def delay(at: Arrival) -> None:
    """The reply comes ``seconds`` later."""
    at.send(at.executed(), after=at.given["seconds"])


def lose(at: Arrival) -> None:
    """Execute the request, never answer; the connection stays."""
    at.executed()


def drop(at: Arrival) -> None:
    """Neither execute nor answer; the connection stays."""


def cut(at: Arrival) -> None:
    """Execute, do not answer, and end all data connections; the worker lives."""
    lose(at)
    at.server.cut_data()


def cut_after(at: Arrival) -> None:
    """Execute and answer, then end all data connections while the client is idle; the worker lives."""
    at.send(at.executed())
    time.sleep(_ON_ITS_WAY)
    at.server.cut_data()


def cut_before(at: Arrival) -> None:
    """Do not execute, and end all data connections; the worker lives."""
    at.server.cut_data()


def die(at: Arrival) -> None:
    """Execute, do not answer, and end the worker; ``worker`` is the state in the next PROBED."""
    lose(at)
    die_before(at)


def die_before(at: Arrival) -> None:
    """Do not execute, and end the worker."""
    at.server.worker = at.given.get("worker", "dead")
    at.server.session.lose_worker()
    at.server.close_data()


def die_forgetting(at: Arrival) -> None:
    """Do not execute; the worker ends and loses the last ``steps``, which were committed but not durable."""
    die_before(at)
    at.server.session.forget(at.given["steps"])


def fence(at: Arrival) -> None:
    """Another client resumes the session just before this request."""
    at.server.session.resume()
    at.send(at.executed())


def fence_silently(at: Arrival) -> None:
    """Another client resumes the session, and this request's connection ends."""
    at.server.session.resume()
    at.server.cut_data()


def twice(at: Arrival) -> None:
    """Send the reply twice, the second time late."""
    reply = at.executed()
    at.send(reply)
    at.send(reply, after=at.given.get("seconds", 0.0))


def refuse(at: Arrival) -> None:
    """ERROR ``code`` instead of the execution."""
    details = at.given.get("details", {})
    at.send(error(at.given["code"], at.server.session.state, **details))


def fields(at: Arrival) -> None:
    """The reply with other fields: ``set`` overrides, ``without`` leaves out."""
    reply = at.executed()
    kept = {name: value for name, value in reply.fields.items() if name not in at.given.get("without", ())}
    at.send(Reply(reply.kind, kept | at.given.get("set", {}), reply.arrays))


def header(at: Arrival) -> None:
    """The reply with other keys in frame 0: ``set``."""
    at.send(at.executed(), **at.given["set"])


def foreign_first(at: Arrival) -> None:
    """Send replies to other requests before the reply: an earlier sequence, a later one, another client."""
    reply = at.executed()
    wrong = Reply(reply.kind, reply.fields | at.given.get("set", {}), reply.arrays)
    number = at.request.sequence
    for other in ({"sequence": number + 7}, {"sequence": max(number - 1, 0)}, {"client": bytes(16)}):
        at.send(wrong, **other)
    at.send(reply)


def garbage(at: Arrival) -> None:
    """Frames that are not a message, in hexadecimal: ``frames``."""
    at.executed()
    at.put([bytes.fromhex(frame) for frame in at.given["frames"]])


def narrow(at: Arrival) -> None:
    """Send the reply's arrays with four bytes per item."""
    reply = at.executed()
    arrays = {name: array.astype(f"<{array.dtype.kind}4") for name, array in reply.arrays.items()}
    at.send(Reply(reply.kind, reply.fields, arrays))


def spelled(at: Arrival) -> None:
    """Send the reply's header in another encoding: keys in descending order, sequence in 64 bits."""
    first, *rest = at.server.frames(at.request, at.executed(), sequence=0)
    header: dict[str, Any] = msgpack.unpackb(first)
    del header["sequence"]
    packed = b"\xde\x00\x06" + b"".join(pack(key) + pack(header[key]) for key in sorted(header, reverse=True))
    at.put([packed + pack("sequence") + b"\xcf" + at.request.sequence.to_bytes(8, "big"), *rest])


def misframed(at: Arrival) -> None:
    """The reply with a frame too ``few``, too ``many``, or ``short``."""
    frames = at.server.frames(at.request, at.executed())
    changed = {"few": frames[:-1], "many": [*frames, b"x"], "short": [*frames[:-1], frames[-1][:-1]]}
    at.put(changed[at.given["how"]])


ACTIONS: dict[str, Callable[[Arrival], None]] = {
    action.__name__.replace("_", "-"): action
    for action in (
        delay, lose, drop, cut, cut_after, cut_before, die, die_before, die_forgetting, fence, fence_silently, twice,
        refuse, fields, header, foreign_first, garbage, narrow, spelled, misframed,
    )
}  # fmt: skip
