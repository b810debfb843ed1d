"""Section 21: the promises of each level of durability that the server offers, as far as a client can check them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from mesh_motion_conformance.case import Skip, require
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.session import Session
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.show import show

Play = Callable[[Stage, Session, str], None]


def _session(stage: Stage, level: str) -> Session:
    """A session of this level, READY, shared by the cases for this level."""
    offered = answered(stage.ask(Request("HELLO")), "WELCOME").fields["durability"]
    if level not in offered:
        raise Skip(f"this server does not offer {level}")
    return stage.kept(f"durability {level}", lambda: stage.open(durability=level)).reach("READY")


def _durable_step(stage: Stage, session: Session, level: str) -> None:
    before, durable = session.step, session.step_on().fields["durable_step"]
    step = session.step
    fits = durable == step or (level == "relaxed" and durable <= before + 1)
    require(fits, f"durable_step {step} of COMMITTED", str(durable))
    stage.until(session.status, lambda status: bool(status["durable_step"] == step))
    session.do("STATUS", durable_step=step)


def _stored_reply(_: Stage, session: Session, __: str) -> None:
    session.do("MOVE")
    number, commit = session.lines[0].next(), session.request("COMMIT")
    first = answered(session.ask(commit, sequence=number), "COMMITTED")
    again = session.ask(commit, sequence=number)
    session.step = first.fields["step"]
    require(again.frames == first.frames, f"the stored reply, {show(first)}", show(again))


def _after(leave: Callable[[Session], object]) -> Play:
    """After commit, disconnection and RESUME no committed step is lost."""

    def play(_: Stage, session: Session, __: str) -> None:
        session.step_on()
        session.step_on()
        session.do("MOVE")
        client, number, commit = session.lines[0].client, session.lines[0].next(), session.request("COMMIT")
        first = answered(session.ask(commit, sequence=number), "COMMITTED")
        points = session.do("FETCH").arrays["points"].tobytes()
        leave(session)
        answered(session.resume(), "RESUMED", step=first.fields["step"])
        answered(session.join()[0], "JOINED", step=first.fields["step"])
        same = session.do("FETCH").arrays["points"].tobytes() == points
        require(same, "the committed coordinates, bitwise", "others")
        again = session.ask(commit.having(epoch=session.epoch), sequence=number, client=client)
        same = answered(again, "COMMITTED").fields == first.fields
        require(same, f"the stored reply, {show(first)}", show(again))
        session.step_on()

    return play


def _later_step(_: Stage, session: Session, level: str) -> None:
    session.step_on()
    session.do("CLOSE")
    session.take_up()
    far = session.request("MOVE").having(step=session.step + 4)
    refused(session.ask(far), "ABORTED.STEPS_LOST" if level == "relaxed" else "FAILED_PRECONDITION.STEP")
    session.step_on()


@suite.family(lambda stage, play, level: play(stage, _session(stage, level), level))
def levels() -> Iterator[tuple[str, str, str, Play, str]]:
    """21"""
    leaving, living = _after(lambda session: session.do("CLOSE")), _after(lambda _: None)
    for level in ("full", "replay", "relaxed"):
        for section, name, demand, play in (
            ("21.2", "durable-step", "durable_step is the step; with relaxed it reaches it in the end", _durable_step),
            ("21.2", "stored-reply", "A repeated COMMIT gets the reply with the durable_step first given",
             _stored_reply),
            ("21.3", "CLOSE-and-RESUME", "CLOSE makes every committed step durable", leaving),
            ("21.3", "RESUME-of-a-living-session", "RESUME makes every committed step durable", living),
            ("21.5", "step-after-the-next",
             "A later step than the next is refused by its own code where steps may be lost", _later_step),
        ):  # fmt: skip
            yield section, f"{name}-{level}", demand, play, level
