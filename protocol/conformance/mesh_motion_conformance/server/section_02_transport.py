"""Section 2: sockets, endpoints, one reply a request."""

from __future__ import annotations

import contextlib
import os

from mesh_motion_conformance.case import Rows, Unmet, require
from mesh_motion_conformance.checks import answered, check_identity, refused
from mesh_motion_conformance.line import Ended, Line, Silence
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.show import show
from mesh_motion_conformance.tables import tables
from mesh_motion_conformance.wire import CHUNK_BYTES, HEADER_BYTES, pack


@suite("2.1")
def no_delimiter_frame(stage: Stage) -> None:
    """The first frame of a reply is frame 0: there is no empty delimiter."""
    reply = answered(stage.ask(Request("PING")), "PONG")
    require(len(reply.frames) == 1, "PONG in one frame", f"{len(reply.frames)} frames")


@suite("2.1")
def delimiter_frame_is_no_header(stage: Stage) -> None:
    """An empty frame before frame 0 is not a delimiter: it is read as frame 0, and is not a header."""
    line = stage.line()
    stage.put(line, [b"", *Request("PING").frames(line.client, 1)])
    refused(line.receive(), "INVALID_ARGUMENT.HEADER")


def _taken_by(endpoint: str, suffix: str) -> Rows:
    """The kinds of request that this endpoint takes."""
    return {f"{kind}-{suffix}": (kind,) for kind, row in tables().requests.items() if row["endpoint"] == endpoint}


@suite("2.2", lambda: _taken_by("data", "at-control"))
def data_request_at_control(stage: Stage, kind: str) -> None:
    """The control endpoint takes no requests of a session."""
    refused(stage.ask(stage.session("READY").request(kind)), "UNIMPLEMENTED.MESSAGE")


@suite("2.2", lambda: _taken_by("control", "at-data"))
def control_request_at_data(stage: Stage, kind: str) -> None:
    """A data endpoint takes no requests of the control endpoint."""
    session = stage.session("READY")
    request = Request("OPEN", {"dimension": 2}) if kind == "OPEN" else session.request(kind)
    refused(session.ask(request), "UNIMPLEMENTED.MESSAGE", state="READY")


@suite("2.2")
def ping_at_control(stage: Stage) -> None:
    """PING is taken by the control endpoint."""
    answered(stage.ask(Request("PING")), "PONG")


@suite("2.2")
def ping_at_data(stage: Stage) -> None:
    """PING is accepted by a data endpoint, also from a connection that has not joined."""
    session = stage.session("READY")
    answered(session.ask("PING"), "PONG")
    answered(stage.ask(Request("PING"), session.connect()), "PONG")


@suite("2.4")
def replies_in_the_order_of_requests(stage: Stage) -> None:
    """Replies on a data connection come in the order of its requests; after a loss the repeated request gets it."""
    session = stage.session("READY")
    line = session.lines[0]
    for pair in (("PING", "STATUS"), ("MOVE", "PING"), ("FETCH", "ROLLBACK"), ("MOVE", "FETCH")):
        requests = {session.send(request): request for request in map(session.request, pair)}
        got = _arriving(line, len(requests))
        in_order = got == sorted(got) and set(got) <= set(requests)
        require(in_order, f"replies to {list(requests)} in this order", f"replies to {got}")
        for number in requests.keys() - set(got):
            stage.ask(requests[number], line, sequence=number)


def _arriving(line: Line, count: int) -> list[int]:
    """Numbers of the given count of replies, fewer if some were lost."""
    got: list[int] = []
    with contextlib.suppress(Silence):
        while len(got) < count:
            got.append(line.receive(2.0 if got else None).sequence)
    return got


@suite("2.5")
def other_connections_get_nothing(stage: Stage) -> None:
    """A reply goes to the connection that its request came from, for any client in the header."""
    first, second = stage.line(), stage.line()
    answered(stage.ask(Request("PING"), first), "PONG")
    stage.put(second, Request("PING").frames(first.client, 7))
    check_identity(second.receive(), first.client, 7)
    if first.pending():
        raise Unmet("nothing on the other connection", show(first.receive()))


@suite("2.5")
def one_reply_to_each_of_many(stage: Stage) -> None:
    """Every request is answered by exactly one reply."""
    line = stage.line()
    replies: dict[int, str] = {}
    for number in range(1, 17, 2):
        stage.put(line, Request("PING").frames(line.client, number))
        stage.put(line, Request("LIST").frames(line.client, number + 1))
        replies |= {reply.sequence: reply.kind for reply in (line.receive(), line.receive())}
    wanted = {number: "PONG" if number % 2 else "LISTED" for number in range(1, 17)}
    require(replies == wanted, "PONG to the odd ones of 16 requests, LISTED to the even ones", str(replies))
    with contextlib.suppress(Silence):
        raise Unmet("16 replies", f"one more: {show(line.receive(0.1))}")


@suite("2.6")
def oversized_frame_at_control(stage: Stage) -> None:
    """A frame larger than max_header_bytes ends a control connection without a reply."""
    _ends(stage, stage.line(), HEADER_BYTES + 1)


@suite("2.6")
def oversized_frame_at_data(stage: Stage) -> None:
    """A frame larger than max_chunk_bytes ends a data connection without a reply."""
    _ends(stage, stage.session("READY").connect(), CHUNK_BYTES + 1)


@suite("2.6")
def oversized_frame_hurts_no_other_client(stage: Stage) -> None:
    """The end of such a connection does not disturb the others."""
    answered(stage.session("READY").ask("STATUS"), "STATUS_REPORT")
    answered(stage.ask(Request("PING")), "PONG")


def _ends(stage: Stage, line: Line, size: int) -> None:
    """Check that one frame of this size ends the connection."""
    answered(stage.ask(Request("PING"), line), "PONG")
    stage.put(line, [pack(b"").ljust(size, b"\0")])
    try:
        reply = line.receive()
    except Ended:
        return
    finally:
        line.close()
    raise Unmet("the end of the connection", show(reply))


@suite("2.5")
def unfinished_message_is_no_request(stage: Stage) -> None:
    """A message whose last frame never comes is not executed, and its connection's end disturbs no other client."""
    session = stage.session("TRIAL")
    line = session.connect()
    answered(stage.ask(session.request("JOIN"), line), "JOINED")
    session.lines[0].close()
    session.lines[0] = line
    header = session.request("MOVE").frames(line.client, line.next())[0]
    line.send_part(header)
    line.close()
    session.join()
    session.do("STATUS", state="TRIAL", iteration=1)


@suite("2.5")
def garbage_is_answered(stage: Stage) -> None:
    """Random frames are answered by ERROR like any request, with number 0."""
    line = stage.line()
    for size in (1, 17, 256, 4096):
        stage.put(line, [b"\xc1" + os.urandom(size)])
        reply = refused(line.receive(), "INVALID_ARGUMENT.HEADER")
        require(reply.sequence == 0, "sequence 0 in the reply to a request whose number was not readable", show(reply))
