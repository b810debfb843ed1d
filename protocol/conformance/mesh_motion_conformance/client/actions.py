"""Actions of a script on a request or its reply, by name."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import msgpack
import zmq

from mesh_motion_conformance.client.scripted_session import Reply, error
from mesh_motion_conformance.wire import Message, pack

if TYPE_CHECKING:
    from mesh_motion_conformance.client.scripted_server import ScriptedServer

__all__ = ["ACTIONS"]

#: A reply has left within this, seconds.
_ON_ITS_WAY = 0.1

Action = Callable[["ScriptedServer", "zmq.Socket[bytes]", bytes, Message, dict[str, Any]], None]


def _executed(server: ScriptedServer, request: Message) -> Reply:
    endpoint = "control" if request.kind in ("HELLO", "OPEN", "RESUME", "LIST", "PROBE") else "data"
    return server.execute(request, endpoint)


def delay(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """The reply comes ``seconds`` later."""
    server.send(socket, peer, request, _executed(server, request), after=given["seconds"])


def lose(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """Execute the request, never answer; the connection stays."""
    del socket, peer, given
    _executed(server, request)


def drop(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """Neither execute nor answer; the connection stays."""


def cut(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """Execute, do not answer, and end all data connections; the worker lives."""
    lose(server, socket, peer, request, given)
    server.cut_data()


def cut_after(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """Execute and answer, then end all data connections while the client is idle; the worker lives."""
    del given
    server.send(socket, peer, request, _executed(server, request))
    time.sleep(_ON_ITS_WAY)
    server.cut_data()


def cut_before(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """Do not execute, and end all data connections; the worker lives."""
    del socket, peer, request, given
    server.cut_data()


def die(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """Execute, do not answer, and end the worker; ``worker`` is the state in the next PROBED."""
    lose(server, socket, peer, request, given)
    die_before(server, socket, peer, request, given)


def die_before(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """Do not execute, and end the worker."""
    del socket, peer, request
    server.worker = given.get("worker", "dead")
    server.session.lose_worker()
    server.close_data()


def die_forgetting(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """Do not execute; the worker ends and loses the last ``steps``, which were committed but not durable."""
    die_before(server, socket, peer, request, given)
    server.session.forget(given["steps"])


def fence(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """Another client resumes the session just before this request."""
    del given
    server.session.resume()
    server.send(socket, peer, request, _executed(server, request))


def fence_silently(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """Another client resumes the session, and this request's connection ends."""
    del socket, peer, request, given
    server.session.resume()
    server.cut_data()


def twice(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """Send the reply twice, the second time late."""
    reply = _executed(server, request)
    server.send(socket, peer, request, reply)
    server.send(socket, peer, request, reply, after=given.get("seconds", 0.0))


def refuse(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """ERROR ``code`` instead of the execution."""
    details = given.get("details", {})
    server.send(socket, peer, request, error(given["code"], server.session.state, **details))


def fields(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """The reply with other fields: ``set`` overrides, ``without`` leaves out."""
    reply = _executed(server, request)
    kept = {name: value for name, value in reply.fields.items() if name not in given.get("without", ())}
    server.send(socket, peer, request, Reply(reply.kind, kept | given.get("set", {}), reply.arrays))


def header(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """The reply with other keys in frame 0: ``set``."""
    server.send(socket, peer, request, _executed(server, request), **given["set"])


def foreign_first(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """Send replies to other requests before the reply: an earlier sequence, a later one, another client."""
    reply = _executed(server, request)
    wrong = Reply(reply.kind, reply.fields | given.get("set", {}), reply.arrays)
    for other in (
        {"sequence": request.sequence + 7},
        {"sequence": max(request.sequence - 1, 0)},
        {"client": bytes(16)},
    ):
        server.send(socket, peer, request, wrong, **other)
    server.send(socket, peer, request, reply)


def garbage(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """Frames that are no message, in hexadecimal: ``frames``."""
    _executed(server, request)
    server.put(socket, peer, [bytes.fromhex(frame) for frame in given["frames"]])


def narrow(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """Send the reply's arrays with four bytes per item."""
    del given
    reply = _executed(server, request)
    arrays = {name: array.astype(f"<{array.dtype.kind}4") for name, array in reply.arrays.items()}
    server.send(socket, peer, request, Reply(reply.kind, reply.fields, arrays))


def spelled(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """Send the reply's header in another encoding: keys in descending order, sequence in 64 bits."""
    del given
    first, *rest = server.frames(request, _executed(server, request), sequence=0)
    header: dict[str, Any] = msgpack.unpackb(first)
    del header["sequence"]
    packed = b"\xde\x00\x06" + b"".join(pack(key) + pack(header[key]) for key in sorted(header, reverse=True))
    server.put(socket, peer, [packed + pack("sequence") + b"\xcf" + request.sequence.to_bytes(8, "big"), *rest])


def misframed(server: ScriptedServer, socket: Any, peer: bytes, request: Message, given: dict[str, Any]) -> None:
    """The reply with a frame too ``few``, too ``many``, or ``short``."""
    frames = server.frames(request, _executed(server, request))
    changed = {"few": frames[:-1], "many": [*frames, b"x"], "short": [*frames[:-1], frames[-1][:-1]]}
    server.put(socket, peer, changed[given["how"]])


ACTIONS: dict[str, Action] = {
    action.__name__.replace("_", "-"): action
    for action in (
        delay, lose, drop, cut, cut_after, cut_before, die, die_before, die_forgetting, fence, fence_silently, twice,
        refuse, fields, header, foreign_first, garbage, narrow, spelled, misframed,
    )
}  # fmt: skip
