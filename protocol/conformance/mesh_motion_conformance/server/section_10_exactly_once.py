"""Section 10: a repeat gets the stored reply, an id is used for one request only."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from mesh_motion_conformance.case import require
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.session import Session
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.show import show
from mesh_motion_conformance.wire import Message

_STATE = {"UPLOAD": "OPENING", "MOVE": "READY", "COMMIT": "TRIAL", "ROLLBACK": "TRIAL"}


def _twice(session: Session, request: Request, other: Request | None = None) -> tuple[int, Message, Message]:
    """Number and replies of a request that is sent twice, or of another one under its number."""
    number = session.lines[0].next()
    first = session.ask(request, sequence=number)
    require(first.kind != "ERROR", f"the reply to {request.kind}", show(first))
    return number, first, session.ask(other or request, sequence=number)


def _stored(again: Message, first: Message) -> None:
    require(again.frames == first.frames, f"the stored reply, {show(first)}", show(again))


@suite("10.1", {f"repeat-of-{kind}": (kind,) for kind in _STATE})
def repeats(stage: Stage, kind: str) -> None:
    """A request that is executed is executed once; its repeat gets the stored reply."""
    session = stage.session(_STATE[kind])
    _, first, again = _twice(session, session.request(kind))
    _stored(again, first)


_COUNTED: dict[str, tuple[str, str, Callable[[Session], Any], int]] = {
    "MOVE-counts-once": ("MOVE", "TRIAL", lambda s: s.status()["iteration"], 1),
    "COMMIT-commits-once": ("COMMIT", "TRIAL", lambda s: s.status()["step"], 1),
    "UPLOAD-appends-once": ("UPLOAD", "OPENING", lambda s: s.do("UPLOAD").fields["rows_total"], 2),
}


@suite("10.1", _COUNTED)
def executed_once(stage: Stage, kind: str, state: str, seen: Callable[[Session], Any], wanted: int) -> None:
    """A repeated {0} counts once: one iteration, one step, the rows of one part."""
    session = stage.session(state)
    before = seen(session)
    _twice(session, session.request(kind))
    after = seen(session)
    require(after - before == wanted, f"{wanted} more than {before}", str(after))


@suite("10.1")
def repeat_of_BUILD(stage: Stage) -> None:
    """The repeat of a BUILD gets the stored BUILT."""
    session = stage.open()
    session.upload()
    _, first, again = _twice(session, session.request("BUILD"))
    _stored(again, first)


@suite("10.1")
def repeat_on_another_connection(stage: Stage) -> None:
    """A client that lost its connection repeats the request on another one, and gets the stored reply."""
    session = stage.session("READY")
    client, number = session.lines[0].client, session.lines[0].next()
    request = session.request("MOVE")
    first = answered(session.ask(request, sequence=number), "MOVED")
    session.join()
    _stored(session.ask(request, sequence=number, client=client), first)


@suite("10.1")
def reply_that_was_never_read(stage: Stage) -> None:
    """A request whose connection was cut before its reply is executed once, and answered when it is repeated."""
    session = stage.session("TRIAL")
    line, request, step = session.lines[0], session.request("COMMIT"), session.step
    number = session.send(request)
    line.close()
    session.join()
    answered(session.ask(request, sequence=number, client=line.client), "COMMITTED", step=step + 1)
    session.do("STATUS", step=step + 1)


_OTHER_CONTENT: dict[str, tuple[str, Callable[[Session, Request], Request]]] = {
    "MOVE-other-displacement": ("MOVE", lambda s, r: r.carrying(displacement=s.rows(size=0.02))),
    "MOVE-one-bit-of-it": ("MOVE", lambda s, r: r.carrying(displacement=s.rows() * (1 + 2**-52))),
    "MOVE-other-frame": ("MOVE", lambda _, r: r.having(frame="reference")),
    "MOVE-other-step": ("MOVE", lambda s, r: r.having(step=s.step + 2)),
    "UPLOAD-other-rows": ("UPLOAD", lambda _, r: r.carrying(rows=r.arrays["rows"] + 1)),
    "UPLOAD-other-shape": ("UPLOAD", lambda _, r: r.carrying(rows=r.arrays["rows"][:0])),
    "UPLOAD-other-name": ("UPLOAD", lambda _, r: r.having(name="other")),
    "MOVE-then-ROLLBACK": ("MOVE", lambda s, _: s.request("ROLLBACK")),
    "COMMIT-then-MOVE": ("COMMIT", lambda s, _: s.request("MOVE")),
    "ROLLBACK-other-step": ("ROLLBACK", lambda s, r: r.having(step=s.step + 7)),
}


@suite("10.2", _OTHER_CONTENT)
def other_content(stage: Stage, kind: str, change: Callable[[Session, Request], Request]) -> None:
    """The same id with another content is answered ABORTED.CONFLICT."""
    session = stage.session(_STATE[kind])
    request = session.request(kind)
    number, first, again = _twice(session, request, change(session, request))
    refused(again, "ABORTED.CONFLICT")
    _stored(session.ask(request, sequence=number), first)


def _same(stage: Stage, kind: str, change: Callable[[Request], Request]) -> None:
    """A repeat that is changed in this way gets the stored reply."""
    session = stage.session(_STATE[kind])
    request = session.request(kind)
    _, first, again = _twice(session, request, change(request))
    _stored(again, first)


@suite.family(_same)
def same_content() -> Iterator[tuple[str, str, str, str, Callable[[Request], Request]]]:
    """10.2"""
    demand = "A field left out and its default are the same content."
    yield "10.2", "default-written-out", demand, "MOVE", lambda request: request.having(partition=0)
    demand = "Fields in another order are the same content."
    yield "10.2", "order-of-fields", demand, "COMMIT", lambda r: Request(r.kind, dict(reversed(r.fields.items())))
    demand = "A repeat that allows another time of computing is the same request."
    yield "10.2", "limit-of-computing-is-no-content", demand, "MOVE", lambda r: r.having(compute_limit_ms=10**9)
    demand = "A repeat that offers memory is the same request; memory that cannot be used is no error."
    memory = {"process": 2**62, "descriptor": 3, "key": bytes(16)}
    yield "22.7", "memory-is-no-content", demand, "MOVE", lambda request: request.having(memory=memory)


@suite("10.2")
def epoch_is_no_content(stage: Stage) -> None:
    """A repeat with the new epoch of a RESUME is the same request."""
    session = stage.session("TRIAL")
    client, number = session.lines[0].client, session.lines[0].next()
    first = answered(session.ask("COMMIT", sequence=number), "COMMITTED")
    step = session.step
    session.take_up()
    request = session.request("COMMIT").having(step=step + 1)
    _stored(session.ask(request, sequence=number, client=client), first)


@suite("10.2")
def ids_of_two_clients(stage: Stage) -> None:
    """The same sequence of another client is another request."""
    session = stage.session("READY")
    number = session.lines[0].next()
    answered(session.ask("MOVE", sequence=number), "MOVED")
    other = session.request("MOVE").carrying(displacement=session.rows(size=0.02))
    answered(session.ask(other, sequence=number, client=bytes(range(16))), "MOVED", iteration=2)


def _after_the_worker(session: Session, kind: str) -> tuple[Message, Message]:
    """The reply to a request, and the reply to its repeat after the end of the worker and a RESUME."""
    client, number = session.lines[0].client, session.lines[0].next()
    request = session.request(kind)
    first = session.ask(request, sequence=number)
    session.do("CLOSE")
    session.take_up()
    return first, session.ask(request.having(epoch=session.epoch), sequence=number, client=client)


@suite("10.4")
def COMMIT_repeated_to_a_restarted_worker(stage: Stage) -> None:
    """The replies to COMMITs are durable: after the worker's end the repeat gets the reply."""
    first, again = _after_the_worker(stage.session("TRIAL", "closing"), "COMMIT")
    same = answered(again, "COMMITTED").fields == answered(first, "COMMITTED").fields
    require(same, f"the reply that was lost, {show(first)}", show(again))


@suite("10.4")
def MOVE_repeated_to_a_restarted_worker(stage: Stage) -> None:
    """A MOVE that is repeated to a restarted worker is computed again, with the same result."""
    first, again = _after_the_worker(stage.session("READY", "closing"), "MOVE")
    same = answered(again, "MOVED").frames[1:] == answered(first, "MOVED").frames[1:]
    require(same, "the same arrays, bitwise", show(again))


@suite("10.5")
def error_is_not_remembered(stage: Stage) -> None:
    """The repeat of a request that was answered by ERROR is tried again."""
    session = stage.session("READY")
    session.do("ROLLBACK")
    number = session.lines[0].next()
    commit = session.request("COMMIT")
    refused(session.ask(commit, sequence=number), "FAILED_PRECONDITION.STATE")
    session.do("MOVE")
    answered(session.ask(commit, sequence=number), "COMMITTED")


@suite("10.6")
def repeat_of_RESUME(stage: Stage) -> None:
    """A repeated RESUME gets the stored reply: the epoch is raised once."""
    session = stage.session("READY")
    number = stage.control.next()
    first = answered(stage.ask(session.request("RESUME"), sequence=number), "RESUMED")
    again = stage.ask(session.request("RESUME"), sequence=number)
    session.epoch = first.fields["epoch"]
    session.join()
    _stored(again, first)


@suite("10.6")
def repeat_of_OPEN(stage: Stage) -> None:
    """A repeated OPEN gets the stored reply, on another connection too; another content is a conflict."""
    line, other = stage.line(), stage.line()
    request = Request("OPEN", {"dimension": 2, "label": "repeated"})
    number = line.next()
    first = answered(stage.ask(request, line, sequence=number, seconds=stage.opening_seconds), "OPENED")
    session = Session(stage, first, ())
    try:
        _stored(stage.ask(request, line, sequence=number), first)
        _stored(stage.ask(request, other, sequence=number, client=line.client), first)
        refused(stage.ask(request.having(label="x"), line, sequence=number), "ABORTED.CONFLICT")
        refused(stage.ask(request.having(dimension=3), line, sequence=number), "ABORTED.CONFLICT")
    finally:
        session.lines = [session.connect()]
        stage.ask(session.request("JOIN"), session.lines[0])
        session.discard()


@suite("10.7", {f"{kind}-is-answered-again": (kind,) for kind in ("PING", "JOIN", "FETCH", "STATUS")})
def again(stage: Stage, kind: str) -> None:
    """A repeat of a request that changes nothing is answered again."""
    session = stage.session("READY")
    number = session.lines[0].next()
    session.ask(kind, sequence=number)
    before = session.ask("STATUS", sequence=number).fields["state"]
    answered(session.ask("MOVE", sequence=number), "MOVED")
    after = session.ask("STATUS", sequence=number).fields["state"]
    require((before, after) == ("READY", "TRIAL"), "STATUS of the moment, READY and then TRIAL", f"{before}, {after}")
