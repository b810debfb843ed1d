"""Section 21: the promises of each level of durability that the server offers, as far as a client can check them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from mesh_motion_conformance.case import Case, Skip, Suite, Unmet, require
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.session import Session
from mesh_motion_conformance.server.stage import Stage
from mesh_motion_conformance.show import show

__all__ = ["suite"]

suite = Suite()

_LEVELS = ("full", "replay", "relaxed")
Play = Callable[[Stage, Session, str], None]


def _session(stage: Stage, level: str) -> Session:
    """A session of this level, READY, shared by the cases for this level."""
    offered = answered(stage.ask(Request("HELLO")), "WELCOME").fields["durability"]
    if level not in offered:
        raise Skip(f"this server does not offer {level}")
    return stage.kept(f"durability {level}", lambda: stage.open(durability=level)).reach("READY")


def _step(session: Session) -> dict[str, object]:
    """Move and commit; COMMITTED's fields."""
    session.do("MOVE")
    return session.do("COMMIT").fields


def _durable_step(stage: Stage, session: Session, level: str) -> None:
    before, committed = session.step, _step(session)
    durable, step = committed["durable_step"], session.step
    if durable != step and not (level == "relaxed" and isinstance(durable, int) and durable <= before + 1):
        raise Unmet(f"durable_step {step} of COMMITTED", str(durable))
    status = stage.until(session.status, lambda status: bool(status["durable_step"] == step))
    if status["durable_step"] != step:
        raise Unmet(f"durable_step {step} of STATUS_REPORT in the end", str(status["durable_step"]))


def _stored_reply(stage: Stage, session: Session, level: str) -> None:
    del stage, level
    session.do("MOVE")
    number, commit = session.lines[0].next(), session.request("COMMIT")
    first = answered(session.ask(commit, sequence=number), "COMMITTED")
    again = session.ask(commit, sequence=number)
    session.step = first.fields["step"]
    require(again.frames == first.frames, f"the stored reply, {show(first)}", show(again))


def _taken_up(session: Session, step: int, wanted: bytes, retry: Callable[[], object]) -> None:
    """Check that the session is at this step, with these coordinates and the reply to its COMMIT."""
    session.join()
    require(session.step == step, f"step {step}", f"step {session.step}")
    require(session.do("FETCH").arrays["points"].tobytes() == wanted, "the committed coordinates, bitwise", "others")
    retry()


def _after(leave: Callable[[Session], object]) -> Play:
    """After commit, disconnection and RESUME no committed step is lost."""

    def play(stage: Stage, session: Session, level: str) -> None:
        del stage, level
        for _ in range(2):
            _step(session)
        session.do("MOVE")
        client, number, commit = session.lines[0].client, session.lines[0].next(), session.request("COMMIT")
        first = answered(session.ask(commit, sequence=number), "COMMITTED")
        points = session.do("FETCH").arrays["points"].tobytes()
        leave(session)
        resumed = session.resume().fields["step"]
        require(resumed == first.fields["step"], f"RESUMED at step {first.fields['step']}", f"step {resumed}")

        def retry() -> None:
            again = session.ask(commit.having(epoch=session.epoch), sequence=number, client=client)
            if answered(again, "COMMITTED").fields != first.fields:
                raise Unmet(f"the stored reply, {show(first)}", show(again))

        _taken_up(session, resumed, points, retry)
        _step(session)

    return play


def _later_step(stage: Stage, session: Session, level: str) -> None:
    del stage
    _step(session)
    session.do("CLOSE")
    session.resume()
    session.join()
    far = session.request("MOVE").having(step=session.step + 4)
    code = "ABORTED.STEPS_LOST" if level == "relaxed" else "FAILED_PRECONDITION.STEP"
    refused(session.ask(far), code)
    _step(session)


def _close(session: Session) -> None:
    session.do("CLOSE")


def _stay(session: Session) -> None:
    """Its worker lives on."""
    del session


_CASES: tuple[tuple[str, str, str, Play], ...] = (
    ("21.2", "durable-step", "durable_step is the step; with relaxed it reaches it in the end", _durable_step),
    ("21.2", "stored-reply", "A repeated COMMIT gets the reply with the durable_step first given", _stored_reply),
    ("21.3", "CLOSE-and-RESUME", "CLOSE makes every committed step durable", _after(_close)),
    ("21.3", "RESUME-of-a-living-session", "RESUME makes every committed step durable", _after(_stay)),
    ("21.5", "step-after-the-next", "A later step than the next is refused by its own code where steps may be lost",
     _later_step),
)  # fmt: skip


@suite.family
def levels() -> Iterator[Case]:
    """21"""
    for level in _LEVELS:
        for section, name, demand, play in _CASES:
            yield Case(section, f"{name}-{level}", demand, partial(_at_level, play, level))


def _at_level(play: Play, level: str, stage: Stage) -> None:
    play(stage, _session(stage, level), level)
