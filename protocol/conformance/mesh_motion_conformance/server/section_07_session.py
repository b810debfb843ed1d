"""Section 7: the promises of a session about its results."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mesh_motion_conformance.case import Unmet, require
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.session import Session
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.wire import Array, Message


def _move(session: Session, size: float = 0.01, frame: str = "committed") -> Message:
    request = session.request("MOVE").having(frame=frame).carrying(displacement=session.rows(size=size))
    return answered(session.ask(request), "MOVED")


def _points(session: Session, what: str = "committed") -> Array:
    return answered(session.ask(session.request("FETCH").having(what=what)), "FETCHED").arrays["points"]


def _bitwise(got: Array, wanted: Array, what: str) -> None:
    if got.shape != wanted.shape or got.tobytes() != wanted.tobytes():
        raise Unmet(f"{what}, bitwise", _first_difference(got, wanted))


def _first_difference(got: Array, wanted: Array) -> str:
    if got.shape != wanted.shape:
        return f"shape {got.shape} for {wanted.shape}"
    at = [tuple(int(i) for i in index) for index in np.argwhere(got != wanted)]
    return f"{got[at[0]]!r} for {wanted[at[0]]!r} at {at[0]}, and {len(at) - 1} others" if at else "another zero or NaN"


_ORDERS = {
    "a-step": ("MOVE, COMMIT",),
    "three-iterations": ("MOVE, MOVE, MOVE, COMMIT",),
    "a-step-dropped": ("MOVE, ROLLBACK, MOVE, COMMIT",),
    "questions-between": ("STATUS, MOVE, STATUS, FETCH, PING, COMMIT, FETCH",),
    "nothing-dropped": ("ROLLBACK, ROLLBACK, MOVE, ROLLBACK",),
}


@suite("7", _ORDERS)
def order(stage: Stage, kinds: str) -> None:
    """A session takes {0}."""
    session = stage.session("READY")
    for kind in kinds.split(", "):
        session.do(kind)


@suite("7.1")
def same_move_same_bytes(stage: Stage) -> None:
    """The same MOVE gives the same bytes in every array, on the first try and on the tenth."""
    session = stage.session("READY")
    first = _move(session)
    for _ in range(9):
        again = _move(session)
        for name, array in first.arrays.items():
            _bitwise(again.arrays[name], array, f"the first try's {name}")


@suite("7.1")
def other_moves_leave_no_trace(stage: Stage) -> None:
    """A MOVED does not depend on the MOVEs before it in the step."""
    session = stage.session("READY")
    first = _move(session, 0.01)
    _move(session, 0.02)
    _move(session, -0.015)
    _bitwise(_move(session, 0.01).arrays["displacement"], first.arrays["displacement"], "the first try's displacement")


@suite("7.1")
def rollback_leaves_no_trace(stage: Stage) -> None:
    """A MOVED does not depend on a trial that was rolled back."""
    session = stage.session("READY")
    first = _move(session)
    session.do("ROLLBACK")
    again = answered(_move(session), "MOVED", iteration=1)
    _bitwise(again.arrays["displacement"], first.arrays["displacement"], "the displacement before the ROLLBACK")


@suite("7.1")
def resume_leaves_no_trace(stage: Stage) -> None:
    """A MOVED depends on the committed state, not on the client or on the worker's caches."""
    session = stage.session("READY")
    first = _move(session)
    session.take_up()
    again = _move(session)
    _bitwise(again.arrays["displacement"], first.arrays["displacement"], "the displacement before the RESUME")


@suite("7.1")
def iterations_are_counted(stage: Stage) -> None:
    """iteration is 1, 2, … within the step."""
    session = stage.session("READY")
    got = [_move(session).fields["iteration"] for _ in range(3)]
    session.do("COMMIT")
    got.append(_move(session).fields["iteration"])
    require(got == [1, 2, 3, 1], "iterations 1, 2, 3, and 1 after the COMMIT", str(got))


def _move_with_nan(session: Session) -> Request:
    rows = session.rows()
    rows[2, 0] = np.nan
    return session.request("MOVE").carrying(displacement=rows)


_REFUSED: dict[str, tuple[Callable[[Session], Request]]] = {
    "MOVE-with-nan": (_move_with_nan,),
    "MOVE-of-another-step": (lambda s: s.request("MOVE").having(step=s.step + 2),),
    "MOVE-of-another-shape": (lambda s: s.request("MOVE").carrying(displacement=np.zeros((1, 2))),),
    "MOVE-that-inverts": (lambda s: s.request("MOVE").carrying(displacement=s.rows(size=50.0)),),
    "COMMIT-of-another-step": (lambda s: s.request("COMMIT").having(step=s.step),),
    "ROLLBACK-of-another-step": (lambda s: s.request("ROLLBACK").having(step=s.step + 2),),
    "UPLOAD-once-built": (lambda s: s.request("UPLOAD"),),
    "BUILD-once-built": (lambda s: s.request("BUILD"),),
    "CLOSE-with-a-wrong-outcome": (lambda s: s.request("CLOSE").having(outcome="burn"),),
}


@suite("7.2", _REFUSED)
def refusals_without_effect(stage: Stage, make: Callable[[Session], Request]) -> None:
    """A request that is answered by ERROR has had no effect; a trial is still there."""
    session = stage.session("TRIAL")
    before, points = session.status(), _points(session)
    refused(session.ask(make(session)), "INVALID_ARGUMENT", "FAILED_PRECONDITION", state="TRIAL")
    session.do("STATUS", **{name: before[name] for name in ("state", "step", "iteration")})
    _bitwise(_points(session), points, "the committed coordinates of before")


@suite("7.2")
def trial_after_a_refused_move_commits(stage: Stage) -> None:
    """After a MOVE that was refused, the earlier trial is what COMMIT commits."""
    session = stage.session("READY")
    trial = _move(session)
    before = _points(session)
    refused(session.ask(session.request("MOVE").having(step=session.step + 5)), "FAILED_PRECONDITION.STEP")
    session.do("COMMIT")
    _bitwise(_points(session), before + trial.arrays["displacement"], "the earlier trial's coordinates")


@suite("7.4")
def own_order(stage: Stage) -> None:
    """All arrays are in the order of the upload: the rows of the moving nodes are those that MOVE gave."""
    session = stage.session("READY")
    rows = session.rows() * np.arange(1, 5)[:, None]
    request = session.request("MOVE").carrying(displacement=rows)
    moved = answered(session.ask(request), "MOVED").arrays["displacement"]
    error = np.abs(moved[session.parts[0].moving] - rows).max()
    require(error <= 1e-9, "the given displacement at each moving node", f"a difference of {error:.1e}")
    fixed = moved[list(session.parts[0].sides["right"].nodes)]
    require(np.abs(fixed).max() <= 1e-9, "no displacement at the fixed nodes", f"up to {np.abs(fixed).max():.1e}")


@suite("7.5", {f"{frame}-frame": (frame,) for frame in ("committed", "reference")})
def sums(stage: Stage, frame: str) -> None:
    """displacement + the frame's coordinates are the coordinates held."""
    session = stage.session("READY")
    _move(session)
    session.do("COMMIT")
    total = session.rows(size=0.013 if frame == "reference" else -0.004)
    if frame == "reference":
        start = _points(session, "committed")[session.parts[0].moving]
        total += start - _points(session, "reference")[session.parts[0].moving]
    base = _points(session, frame)
    request = session.request("MOVE").having(frame=frame).carrying(displacement=total)
    moved = answered(session.ask(request), "MOVED")
    session.do("COMMIT")
    _bitwise(_points(session), base + moved.arrays["displacement"], f"{frame} coordinates + displacement")


@suite("7")
def fetch_shows_no_trial(stage: Stage) -> None:
    """FETCH gives committed coordinates, while there is a trial too."""
    session = stage.session("READY")
    before = _points(session)
    _move(session)
    _bitwise(_points(session), before, "the committed coordinates")
    _bitwise(_points(session, "reference"), session.parts[0].points, "the reference coordinates")


_STEPS: dict[str, tuple[str, str, int, dict[str, str]]] = {
    "MOVED-step": ("MOVE", "READY", 1, {}),
    "COMMITTED-step": ("COMMIT", "TRIAL", 1, {}),
    "ROLLED-BACK-step": ("ROLLBACK", "TRIAL", 0, {}),
    "STATUS-REPORT-step": ("STATUS", "TRIAL", 0, {}),
    "JOINED-step": ("JOIN", "TRIAL", 0, {}),
    "FETCHED-step-of-the-committed-state": ("FETCH", "READY", 0, {"what": "committed"}),
    "FETCHED-step-with-the-reference-mesh": ("FETCH", "READY", 0, {"what": "reference"}),
}


@suite("12", _STEPS)
def steps_reported(stage: Stage, kind: str, state: str, offset: int, fields: dict[str, str]) -> None:
    """step is that of section 12's row."""
    session = stage.session(state)
    if session.step == 0:
        session.reach("TRIAL").do("COMMIT")
        session.reach(state)
    session.do(session.request(kind).having(**fields), step=session.step + offset)
