"""Section 11: broken connections, PROBE, RESUME, fencing."""

from __future__ import annotations

from typing import Any

from mesh_motion_conformance.case import require
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.show import show
from mesh_motion_conformance.tables import tables


@suite("11.1")
def PROBE_of_a_live_session(stage: Stage) -> None:
    """PROBED has "alive", the session's epoch and its endpoint."""
    session = stage.session("READY")
    wanted = {"session": session.id, "worker": "alive", "epoch": session.epoch, "endpoint": session.endpoint}
    answered(stage.ask(session.request("PROBE")), "PROBED", **wanted)


@suite("11.1")
def PROBE_of_a_closed_session(stage: Stage) -> None:
    """PROBED has "none" or "dead", and no endpoint, for a session whose worker has ended."""
    session = stage.session("READY", "closing")
    session.do("CLOSE")
    probe = session.request("PROBE")
    reply = stage.until(lambda: stage.ask(probe), lambda reply: reply.fields["worker"] in ("none", "dead"))
    answered(reply, "PROBED", endpoint="", **({"epoch": 0} if reply.fields["worker"] == "none" else {}))
    session.take_up()


@suite("11.1")
def connecting_again(stage: Stage) -> None:
    """A client whose connection broke connects again and joins under the epoch it holds; a trial is still there."""
    session = stage.session("TRIAL")
    session.lines[0].close()
    answered(session.join()[0], "JOINED", state="TRIAL", iteration=1)
    session.do("COMMIT")


@suite("11.1")
def connection_cut_while_a_move_is_computed(stage: Stage) -> None:
    """A MOVE whose connection is cut at once is executed once, and answered when it is repeated."""
    session = stage.session("READY")
    line, request = session.lines[0], session.request("MOVE")
    number = session.send(request)
    line.close()
    session.join()
    answered(session.ask(request, sequence=number, client=line.client), "MOVED", iteration=1)
    session.do("STATUS", iteration=1)


@suite("11.1")
def newest_connection_speaks(stage: Stage) -> None:
    """The connection that joined last acts for the partition; the previous one must join again."""
    session = stage.session("READY")
    old = session.lines[0]
    session.lines = [session.connect()]
    session.do("JOIN")
    refused(stage.ask(session.request("STATUS"), old), "UNAUTHENTICATED")
    answered(session.ask("STATUS"), "STATUS_REPORT")
    old.close()


@suite("11.3")
def RESUME_raises_the_epoch(stage: Stage) -> None:
    """RESUME raises the session's epoch in any case; JOINED and STATUS have the new epoch."""
    session = stage.session("TRIAL")
    before = session.epoch
    for more in (1, 2, 3):
        answered(session.resume(), "RESUMED", epoch=before + more, session=session.id, state="READY")
    session.join()


@suite("11.3", lambda: {f"{kind}-of-an-older-epoch": (kind,) for kind in tables().data if kind != "PING"})
def fenced(stage: Stage, kind: str) -> None:
    """Requests with an older epoch are answered ABORTED.FENCED."""
    session = stage.session("READY")
    old, request = session.lines[0], session.request(kind)
    session.resume()
    refused(stage.ask(request, old), "ABORTED.FENCED", state="READY")
    session.join()
    refused(session.ask(request), "ABORTED.FENCED", state="READY")


@suite("11.3")
def fenced_holder_has_to_join(stage: Stage) -> None:
    """After RESUME the old connection is no longer joined, even with the new epoch."""
    session = stage.session("READY")
    old = session.lines[0]
    session.resume()
    refused(stage.ask(session.request("STATUS"), old), "UNAUTHENTICATED")
    answered(stage.ask(session.request("JOIN"), old), "JOINED")
    session.join()


@suite("11.4")
def RESUMED_says_the_last_step(stage: Stage) -> None:
    """RESUMED has the last committed step of a worker that lives; 8-READY-CLOSE tests a worker from the journal."""
    session = stage.session("TRIAL")
    step = session.do("COMMIT").fields["step"]
    answered(session.resume(), "RESUMED", step=step, state="READY")
    session.join()


@suite("7.3")
def committed_state_survives_the_worker(stage: Stage) -> None:
    """A session that is BUILT survives the end of its worker at its last committed step, bitwise."""
    session = stage.session("TRIAL", "closing")
    session.do("COMMIT")
    session.do("MOVE")
    before = session.do("FETCH").arrays["points"]
    session.do("CLOSE")
    joined = answered(session.take_up()[0], "JOINED", iteration=0)
    after = session.do("FETCH").arrays["points"]
    require(after.tobytes() == before.tobytes(), "the committed coordinates, bitwise", f"{after[:3].tolist()} …")
    moving = joined.arrays["moving_nodes"].tolist()
    require(moving == session.parts[0].moving.tolist(), "moving_nodes as in BUILT", show(joined))


@suite("11.6")
def discarded_session_is_gone(stage: Stage) -> None:
    """CLOSE with outcome discard deletes the session."""
    session = stage.session("READY", "closing")
    answered(session.ask(session.request("CLOSE").having(outcome="discard")), "CLOSED")
    reply = stage.until(lambda: stage.ask(session.request("PROBE")), lambda reply: reply.kind == "ERROR")
    refused(reply, "NOT_FOUND", state="")
    refused(stage.ask(session.request("RESUME")), "NOT_FOUND", state="")


_WRONG: dict[str, dict[str, Any]] = {
    "wrong-token": {"token": bytes(32)},
    "unknown-session": {"session": "f" * 32},
    "empty-session": {"session": ""},
    "path-as-session": {"session": "../../../etc"},
    "session-in-capitals": {"session": "F" * 32},
}


@suite("11.8", {f"{kind}-{name}": (kind, wrong) for kind in ("RESUME", "PROBE") for name, wrong in _WRONG.items()})
def strangers(stage: Stage, kind: str, wrong: dict[str, Any]) -> None:
    """A session or token that does not exist is answered NOT_FOUND, alike."""
    session = stage.session("READY")
    reply = refused(stage.ask(session.request(kind).having(**wrong)), "NOT_FOUND", state="")
    other = refused(stage.ask(session.request(kind).having(session="f" * 32, token=bytes(32))), "NOT_FOUND")
    alike = set(reply.fields["details"]) == set(other.fields["details"])
    require(alike, "details alike for a wrong token and for no session", show(reply))


@suite("11.8")
def JOIN_with_a_wrong_token(stage: Stage) -> None:
    """JOIN proves the right to the session: a wrong token is answered NOT_FOUND, and the connection has not joined."""
    session = stage.session("READY")
    line = session.connect()
    refused(stage.ask(session.request("JOIN").having(token=bytes(32)), line), "NOT_FOUND")
    refused(stage.ask(session.request("STATUS"), line), "UNAUTHENTICATED")
    answered(session.ask("STATUS"), "STATUS_REPORT")


@suite("11.8", lambda: {f"{kind}-of-another-session": (kind,) for kind in tables().data if kind != "PING"})
def other_sessions(stage: Stage, kind: str) -> None:
    """A data endpoint knows its own session only."""
    session = stage.session("READY")
    refused(session.ask(session.request(kind).having(session="f" * 32)), "NOT_FOUND", state="READY")


@suite("11.8")
def LIST_shows_no_secrets(stage: Stage) -> None:
    """LISTED holds no token."""
    session = stage.session("READY")
    listed = answered(stage.ask(Request("LIST")), "LISTED")
    shown = any(session.token in frame or session.token.hex().encode() in frame for frame in listed.frames)
    require(not shown, "no secrets", "the session's token in LISTED")
