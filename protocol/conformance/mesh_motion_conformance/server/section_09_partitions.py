"""Section 9: sessions of two partitions."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mesh_motion_conformance.case import Skip, Unmet, require
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.line import Silence
from mesh_motion_conformance.server.mesh import HALVES, SQUARE, Part
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.session import Session
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.show import show
from mesh_motion_conformance.tables import tables
from mesh_motion_conformance.wire import Message

_PARTITION = "INVALID_ARGUMENT.PARTITION"


def _pair(stage: Stage, state: str = "READY") -> Session:
    """A session of two partitions, shared by the cases, in state READY or TRIAL."""
    session = stage.kept("pair", lambda: _built(stage.open(*HALVES)))
    now = session.status()
    session.step = now["step"]
    if now["state"] == "TRIAL" and state == "READY":
        _all(session.together("ROLLBACK"), "ROLLED_BACK")
    elif now["state"] == "READY" and state == "TRIAL":
        _all(session.together("MOVE"), "MOVED")
    return session


def _built(session: Session) -> Session:
    session.upload()
    _all(session.together("BUILD"), "BUILT")
    return session


def _all(replies: list[Message], kind: str) -> list[Message]:
    return [answered(reply, kind) for reply in replies]


def _silent(session: Session, partition: int) -> None:
    """Check that no reply comes: the request waits for the other partition."""
    with contextlib.suppress(Silence):
        reply = session.lines[partition].receive(0.1)
        raise Unmet("no reply before the other partition's request", show(reply))


@suite("9.1")
def each_gets_its_own_nodes(stage: Stage) -> None:
    """BUILT's moving_nodes, JOINED's nodes and FETCHED's points are those of the partition, in its order."""
    session = _pair(stage)
    for partition, part in enumerate(HALVES):
        joined = session.do("JOIN", partition, nodes=len(part.points), partitions=2)
        moving = joined.arrays["moving_nodes"].tolist()
        require(moving == part.moving.tolist(), f"moving_nodes {part.moving.tolist()}", str(moving))
        reference = session.request("FETCH", partition).having(what="reference")
        points = session.do(reference, partition).arrays["points"]
        same = points.tobytes() == part.points.tobytes()
        require(same, "the partition's coordinates as uploaded", f"{points[:2].tolist()} …")


_BEYOND = {
    f"{kind}-of-partition-{partition}": (kind, partition)
    for kind in ("JOIN", "MOVE", "STATUS", "FETCH", "CLOSE")
    for partition in (2, 255)
}


@suite("9.1", _BEYOND)
def partition_numbers(stage: Stage, kind: str, partition: int) -> None:
    """There are as many partitions as OPEN said."""
    session = _pair(stage)
    refused(session.ask(session.request(kind).having(partition=partition)), "INVALID_ARGUMENT.VALUE")


@suite("9.1")
def other_partitions_connection(stage: Stage) -> None:
    """A connection acts for the partition that it joined, and for no other."""
    session = _pair(stage)
    refused(session.ask(session.request("STATUS").having(partition=1), 0), "UNAUTHENTICATED")


@suite("9.2", {f"{kind}-waits-for-all": (kind,) for kind in ("MOVE", "ROLLBACK", "COMMIT")})
def collective(stage: Stage, kind: str) -> None:
    """{0} waits for every partition and answers each."""
    session = _pair(stage, "TRIAL" if kind == "COMMIT" else "READY")
    number = session.send(session.request(kind, 1), 1)
    _silent(session, 1)
    session.do("STATUS", waiting_for=[0])
    other = session.send(session.request(kind, 0))
    for reply in (session.receive(number, 1), session.receive(other)):
        answered(reply, tables().requests[kind]["reply"])
    session.do("STATUS", waiting_for=[])


def _tangent(session: Session, vectors: int) -> Request:
    velocity = np.tile(session.rows(vectors - 1), vectors)
    return Request("TANGENT", session.address(vectors - 1), {"velocity": velocity})


_AT_ODDS: dict[str, tuple[Callable[[Session], Request], Callable[[Session], Request]]] = {
    "MOVE-and-COMMIT": (lambda s: s.request("MOVE", 0), lambda s: s.request("COMMIT", 1)),
    "ROLLBACK-and-COMMIT": (lambda s: s.request("ROLLBACK", 0), lambda s: s.request("COMMIT", 1)),
    "two-frames": (lambda s: s.request("MOVE", 0), lambda s: s.request("MOVE", 1).having(frame="reference")),
    "two-numbers-of-vectors": (lambda s: _tangent(s, 1), lambda s: _tangent(s, 2)),
}


@suite("9.2", _AT_ODDS)
def disagreement(stage: Stage, *make: Callable[[Session], Request]) -> None:
    """Partitions that ask for different things are all refused."""
    session = _pair(stage, "TRIAL")
    for reply in session.together(*(each(session) for each in make)):
        refused(reply, _PARTITION, state="TRIAL")


def _moves(session: Session, sizes: tuple[float, float]) -> list[Message]:
    """Replies to a MOVE of both partitions, each by its own displacement."""
    rows = [session.rows(partition, size) for partition, size in enumerate(sizes)]
    return session.together(*(session.request("MOVE", p).carrying(displacement=rows[p]) for p in (0, 1)))


@suite("9.3")
def own_rows(stage: Stage) -> None:
    """Each partition sends values of its moving nodes and gets values of all its nodes; shared nodes agree bitwise."""
    session = _pair(stage)
    low, high = (reply.arrays["displacement"] for reply in _all(session.together("MOVE"), "MOVED"))
    shapes = low.shape, high.shape
    require(shapes == ((12, 2), (8, 2)), "displacements of shape (12, 2) and (8, 2)", str(shapes))
    shared = {number: index for index, number in enumerate(HALVES[1].global_ids)}
    for index, number in enumerate(HALVES[0].global_ids):
        if number in shared and low[index].tobytes() != high[shared[number]].tobytes():
            raise Unmet(f"one displacement of node {number}", f"{low[index].tolist()}, {high[shared[number]].tolist()}")


@suite("9.3")
def shared_node_moved_to_two_places(stage: Stage) -> None:
    """A node that several partitions give is given the same displacement by each."""
    for reply in _moves(_pair(stage, "TRIAL"), (0.01, 0.02)):
        refused(reply, "INVALID_ARGUMENT", state="TRIAL")


@suite("9.3")
def shared_node_moved_by_two_roundings(stage: Stage) -> None:
    """Displacements of a shared node may differ by 1e-7 of the mesh's longest side; the larger component is taken."""
    session = _pair(stage, "READY")
    extent = np.ptp(np.concatenate([part.points for part in HALVES]), axis=0).max()
    rows = [session.rows(partition, 0.01) + partition * 5e-8 * extent for partition in (0, 1)]
    asked = (session.request("MOVE", partition).carrying(displacement=rows[partition]) for partition in (0, 1))
    replies = _all(session.together(*asked), "MOVED")
    moved = [
        dict(zip(part.global_ids, reply.arrays["displacement"].tolist(), strict=True))
        for part, reply in zip(HALVES, replies, strict=True)
    ]
    given = dict(zip(np.take(HALVES[1].global_ids, HALVES[1].moving), rows[1].tolist(), strict=True))
    for node in set(given) & set(np.take(HALVES[0].global_ids, HALVES[0].moving)):
        if not moved[0][node] == moved[1][node] == given[node]:
            raise Unmet(f"node {node} at {given[node]}", f"{moved[0][node]} and {moved[1][node]}")


@suite("9.4")
def wrong_in_itself(stage: Stage) -> None:
    """Only the partition with a wrong request gets an answer; the others wait for the corrected request."""
    session = _pair(stage)
    number = session.send(session.request("MOVE"))
    rows = session.rows(1)
    rows[0, 0] = np.inf
    refused(session.ask(session.request("MOVE", 1).carrying(displacement=rows), 1), "INVALID_ARGUMENT.NONFINITE")
    _silent(session, 0)
    session.do("MOVE", 1)
    answered(session.receive(number), "MOVED")


@suite("9.4")
def failing_once_all_have_come(stage: Stage) -> None:
    """If the request fails after every partition has sent its part, each of them gets the error."""
    for reply in _moves(_pair(stage, "TRIAL"), (50.0, 50.0)):
        refused(reply, "FAILED_PRECONDITION.QUALITY", state="TRIAL")


@suite("9.4")
def missing_partition(stage: Stage) -> None:
    """After collective_timeout_ms those that wait are answered DEADLINE_EXCEEDED, naming the missing partitions."""
    seconds = stage.limits()["collective_timeout_ms"] / 1000
    if seconds > stage.patience:
        raise Skip(f"it takes {seconds:g} s; start the server with a shorter time, or use --patience")
    session = _pair(stage)
    number = session.send(session.request("MOVE"))
    time.sleep(seconds)
    reply = refused(session.receive(number), "DEADLINE_EXCEEDED", state="READY")
    named = [p for value in reply.fields["details"].values() if isinstance(value, list) for p in value]
    require(1 in named, "details that name partition 1", show(reply))


@suite("9.4")
def given_up_for_another(stage: Stage) -> None:
    """If a partition makes another collective request while one of its own waits, the waiting one ends."""
    session = _pair(stage)
    first = session.send(session.request("MOVE"))
    second = session.send(session.request("MOVE").carrying(displacement=session.rows(0, 0.02)))
    refused(session.receive(first), "ABORTED.STALE", state="READY")
    session.do(session.request("MOVE", 1).carrying(displacement=session.rows(1, 0.02)), 1)
    answered(session.receive(second), "MOVED")


@suite("2.5")
def repeated_request_is_answered_where_it_was_repeated_last(stage: Stage) -> None:
    """A repeated request is answered on the connection that repeated it last."""
    session = _pair(stage)
    first = session.lines[0]
    request, number = session.request("MOVE", 0), first.next()
    stage.put(first, request.frames(first.client, number))
    session.lines[0] = session.connect()
    session.do("JOIN", 0)
    stage.put(session.lines[0], request.frames(first.client, number))
    session.do("STATUS", 0)  # what comes over another connection may overtake the repeat until it has arrived
    session.do("MOVE", 1)
    reply = answered(session.lines[0].receive(stage.opening_seconds), "MOVED")
    require(reply.sequence == number, f"the reply to request {number}", show(reply))
    if first.pending():
        raise Unmet("no reply on the first connection", show(first.receive()))
    first.close()


@suite("10.2")
def waiting_request_with_another_content(stage: Stage) -> None:
    """A request with the id of a waiting request but another content is answered ABORTED.CONFLICT."""
    session = _pair(stage)
    number = session.send(session.request("MOVE"))
    conflict = session.request("MOVE").carrying(displacement=session.rows(0, 0.02))
    refused(session.ask(conflict, sequence=number), "ABORTED.CONFLICT")
    session.do("MOVE", 1)
    answered(session.receive(number), "MOVED")


@suite("9.5")
def division_does_not_show(stage: Stage) -> None:
    """The result does not depend on how the mesh is divided: the digest is that of the undivided mesh."""
    pair, whole = _built(stage.open(*HALVES)), stage.open(SQUARE)
    whole.reach("READY")
    for _ in range(2):
        _all(pair.together("MOVE"), "MOVED")
        digests = {reply.fields["digest"] for reply in _all(pair.together("COMMIT"), "COMMITTED")}
        pair.step += 1
        digests.add(whole.step_on().fields["digest"])
        found = str([digest.hex()[:12] for digest in digests])
        require(len(digests) == 1, "one digest of both partitions and of the undivided mesh", found)


@suite("11.5")
def one_resumes_all_join(stage: Stage) -> None:
    """One partition sends RESUME; the others learn endpoint and epoch by PROBE and send JOIN."""
    session = _pair(stage, "TRIAL")
    before = session.epoch
    session.resume()
    answered(stage.ask(session.request("PROBE")), "PROBED", worker="alive", epoch=before + 1)
    for joined in session.join():
        answered(joined, "JOINED", state="READY")
    _all(session.together("MOVE"), "MOVED")


def _unfit(stage: Stage, second: Part) -> None:
    session = stage.open(HALVES[0], second)
    session.upload()
    for reply in session.together("BUILD"):
        refused(reply, "INVALID_ARGUMENT", state="OPENING")


@suite("9.1")
def shared_node_at_two_places(stage: Stage) -> None:
    """A node that several partitions hold has the same coordinates in each"""
    _unfit(stage, replace(HALVES[1], points=HALVES[1].points + 0.05 * (np.arange(8) == 7)[:, None]))


@suite("13.2")
def no_global_ids(stage: Stage) -> None:
    """global_ids are required with more than one partition"""
    _unfit(stage, replace(HALVES[1], global_ids=()))
