"""Section 8: every request in every state that a client can reach."""

from __future__ import annotations

import time

from mesh_motion_conformance.case import Rows, Skip
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.line import Ended, Silence
from mesh_motion_conformance.server.session import Session
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.tables import tables

_REFUSAL = "a refusal"
_REACHED = ("NEW", "OPENING", "READY", "TRIAL")
_UNREACHED = {
    "COMMITTING": "a commit lasts milliseconds and the data endpoint answers nothing meanwhile",
    "FROZEN": "the disk would have to fail",
    "FAILED": "the server would have to fail",
}


def _cells() -> Rows:
    """The state × request table, cell by cell; section 23 has JUDGE and CORRECT."""
    return {
        f"{state}-{kind}": (state, kind, after or _REFUSAL)
        for state in _REACHED
        for kind, after in tables().states[state].items()
        if kind not in ("CLOSE", "JUDGE", "CORRECT", "lease ends")
    }


@suite("8", _cells)
def cell(stage: Stage, state: str, kind: str, after: str) -> None:
    """{0}: {1} leads to {2}."""
    session = stage.session(state)
    if kind == "RESUME":
        session.take_up()
    elif after == _REFUSAL:
        refused(session.ask(kind), "FAILED_PRECONDITION.STATE", state=state)
    elif kind == "BUILD":
        session = stage.open()
        session.build()
    else:
        session.do(kind)
    session.do("STATUS", state=state if after == _REFUSAL else after)


@suite("8", {f"{state}-CLOSE": (state,) for state in _REACHED})
def closing(stage: Stage, state: str) -> None:
    """{0}: CLOSE leads to CLOSED; a session that was built can be resumed, another one is deleted (11.6)."""
    session = stage.session(state, "closing" if state in ("READY", "TRIAL") else "shared")
    step = session.step
    session.do("CLOSE", step=step)
    _is_over(session)
    if state in ("READY", "TRIAL"):
        answered(session.resume(), "RESUMED", state="READY", step=step)
        session.join()
    else:
        refused(stage.ask(session.request("RESUME")), "NOT_FOUND", state="")


def _is_over(session: Session) -> None:
    """In state CLOSED the data endpoint does not answer, or refuses."""
    status = session.request("STATUS")
    try:
        refused(session.stage.ask(status, session.lines[0], seconds=0.3), "FAILED_PRECONDITION.STATE")
    except (Silence, Ended):
        session.lines[0].close()


@suite("8", {state: (state, why) for state, why in _UNREACHED.items()})
def unreached(stage: Stage, state: str, why: str) -> None:
    """The cells of state {0}."""
    del stage
    raise Skip(f"no client can bring a session into {state}: {why}")


_OFFSETS = {"before-the-last": -1, "committed-already": 0, "next-but-one": 2, "largest": None}
_KINDS = ("MOVE", "COMMIT", "ROLLBACK")


@suite("12", {f"{kind}-step-{name}": (kind, offset) for kind in _KINDS for name, offset in _OFFSETS.items()})
def other_steps(stage: Stage, kind: str, offset: int | None) -> None:
    """{0}'s step is the committed step + 1."""
    session = stage.session("READY")
    while session.step < 2:
        session.step_on()
    session.reach("TRIAL")
    step = 2**63 - 1 if offset is None else session.step + offset
    refused(session.ask(session.request(kind).having(step=step)), "FAILED_PRECONDITION.STEP", state="TRIAL")


@suite("8")
def trial_lost_by_a_resume(stage: Stage) -> None:
    """A COMMIT in READY whose trial was lost by a RESUME is refused with ABORTED.TRIAL_LOST."""
    session = stage.session("TRIAL")
    session.take_up()
    refused(session.ask("COMMIT"), "ABORTED.TRIAL_LOST", state="READY")
    session.step_on()


@suite("8")
def trial_lost_by_a_restart(stage: Stage) -> None:
    """A COMMIT in READY whose trial was lost by the end of its worker is refused with ABORTED.TRIAL_LOST."""
    session = stage.session("TRIAL", "closing")
    session.do("CLOSE")
    session.take_up()
    refused(session.ask("COMMIT"), "ABORTED.TRIAL_LOST", "FAILED_PRECONDITION.STATE", state="READY")


@suite("8")
def commit_without_any_trial(stage: Stage) -> None:
    """A COMMIT in READY that had no trial, or rolled it back, is refused with FAILED_PRECONDITION.STATE."""
    session = stage.session("READY")
    session.do("MOVE")
    session.do("ROLLBACK")
    refused(session.ask("COMMIT"), "FAILED_PRECONDITION.STATE", state="READY")


def _lease(stage: Stage) -> float:
    """The time after which a session without connections is suspended, seconds."""
    lease = stage.limits()["lease_ms"] / 1000
    if lease > stage.patience:
        raise Skip(f"the lease takes {lease:g} s; start the server with a shorter one, or use --patience")
    return lease


def _suspended(stage: Stage, state: str, *, connect: bool = True) -> Session:
    """A session whose lease has ended in this state, with new connections."""
    lease = _lease(stage)
    session = stage.session(state, "leased")
    for line in session.lines:
        line.close()
    time.sleep(1.6 * lease)
    session.lines = [session.connect() for _ in session.parts] if connect else []
    return session


@suite("8")
def SUSPENDED_JOIN(stage: Stage) -> None:
    """READY: the lease ends, SUSPENDED; JOIN leads to READY."""
    session = _suspended(stage, "READY")
    refused(session.ask("STATUS"), "UNAUTHENTICATED", state="SUSPENDED")
    session.do("JOIN", state="READY")


@suite("8")
def SUSPENDED_from_TRIAL(stage: Stage) -> None:
    """TRIAL: the lease ends, SUSPENDED; JOIN leads to READY, the trial is lost, and COMMIT is refused."""
    session = _suspended(stage, "TRIAL")
    session.do("JOIN", state="READY", iteration=0)
    refused(session.ask("COMMIT"), "ABORTED.TRIAL_LOST", state="READY")


@suite("8")
def SUSPENDED_RESUME(stage: Stage) -> None:
    """SUSPENDED: RESUME leads to READY."""
    session = _suspended(stage, "READY")
    answered(session.resume(), "RESUMED", state="READY")
    session.join()
    session.do("MOVE")


@suite("8", {f"{state}-lease-ends": (state,) for state in ("NEW", "OPENING")})
def without_a_mesh(stage: Stage, state: str) -> None:
    """{0}: the lease ends, CLOSED; the session is gone."""
    session = _suspended(stage, state, connect=False)
    refused(stage.ask(session.request("RESUME")), "NOT_FOUND", state="")


@suite("2.8")
def lease_holds_while_a_connection_is_open(stage: Stage) -> None:
    """A session's lease holds as long as any connection to its data endpoint is open, silent or not."""
    lease = _lease(stage)
    session = stage.session("TRIAL", "leased")
    time.sleep(1.6 * lease)
    session.do("STATUS", state="TRIAL")


@suite("7", lambda: {f"{kind}-before-JOIN": (kind,) for kind in tables().data if kind not in ("PING", "JOIN")})
def before_join(stage: Stage, kind: str) -> None:
    """JOIN on every data connection first."""
    session = stage.session("READY")
    refused(stage.ask(session.request(kind), session.connect()), "UNAUTHENTICATED", state="READY")
