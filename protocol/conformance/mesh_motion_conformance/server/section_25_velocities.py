"""Section 25: times, velocities of time schemes, and swept volumes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_conformance.case import require
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.server.mesh import SQUARE
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.session import Session
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.show import show
from mesh_motion_conformance.wire import Message

#: Of the reference mesh and of steps, seconds; no two steps are alike.
_TIMES = (2.0, 2.25, 2.375, 3.0)


def _stepping(stage: Stage, time_levels: str = "") -> Session:
    """A session that starts at the first time, READY."""
    session = stage.open(time=_TIMES[0], time_levels=time_levels)
    session.build()
    return session


def _move(session: Session, step: int, **fields: Any) -> Request:
    """The step's MOVE, with its time; the side bends, and moves by a different part in each step."""
    at = {"step": step, "frame": "reference", "time": _TIMES[step]}
    part = (0.0, 1.0, 1.75, 1.25)[step]
    bent = session.rows()
    bent[::2, 1] *= -1.0
    rows = {"displacement": part * bent} | fields.pop("arrays", {})
    return Request("MOVE", session.address() | at | fields, rows)


def _moved(session: Session, step: int, **fields: Any) -> Message:
    return answered(session.ask(_move(session, step, **fields)), "MOVED")


def _close(found: NDArray[np.float64], expected: NDArray[np.float64]) -> None:
    same = found.shape == expected.shape and np.abs(found - expected).max() <= 1e-12 * (1.0 + np.abs(expected).max())
    require(same, f"{expected[0]} at first, shape {expected.shape}", f"{found[0]}, shape {found.shape}")


def _bdf2(x: list[NDArray[np.float64]], times: tuple[float, ...]) -> NDArray[np.float64]:
    """The derivative, at the last of three times, of the parabola through three positions."""
    (a, b, c), (first, middle, last) = times, x
    one, other = (last - middle) / (c - b), (middle - first) / (b - a)
    return one + (one - other) / (c - a) * (c - b)


@suite("25.1")
def times_grow(stage: Stage) -> None:
    """A time that is not later than that of the committed state is refused; JOINED has that of the committed state."""
    session = _stepping(stage)
    move = _move(session, 1)
    for time in (_TIMES[0], _TIMES[0] - 1.0):
        refused(session.ask(move.having(time=time)), "INVALID_ARGUMENT.VALUE")
    _moved(session, 1)
    commit = session.about("COMMIT", step=1, time=_TIMES[2])
    refused(session.ask(commit), "INVALID_ARGUMENT.VALUE", state="TRIAL")
    session.do("COMMIT")
    answered(session.join()[0], "JOINED", time=_TIMES[1])


@suite("25.2")
def bdf1(stage: Stage) -> None:
    """bdf1 is the step's displacement divided by its time; a MOVE without a scheme has no velocities."""
    session = _stepping(stage)
    last = np.zeros_like(session.parts[0].points)
    for step in (1, 2):
        moved = _moved(session, step, velocity="bdf1")
        now = moved.arrays["displacement"]
        _close(moved.arrays["velocity"], (now - last) / (_TIMES[step] - _TIMES[step - 1]))
        require("velocity" not in _moved(session, step).arrays, "no velocity", "velocity")
        session.do("COMMIT")
        last = now


@suite("25.2")
def tangent(stage: Stage) -> None:
    """tangent equals the answer of TANGENT at the trial."""
    session = _stepping(stage)
    v = session.rows(size=1.0)
    moved = _moved(session, 1, velocity="tangent", arrays={"boundary_velocity": v})
    request = session.about("TANGENT", {"velocity": v}, what="trial")
    _close(moved.arrays["velocity"], session.do(request).arrays["velocity"])


@suite("25.3")
def bdf2_survives(stage: Stage) -> None:
    """bdf2 is the derivative of the parabola through three positions, also after ROLLBACK and RESUME."""
    session = _stepping(stage, "bdf2")
    x = [np.zeros_like(session.parts[0].points)]
    for step in (1, 2, 3):
        session.do(_move(session, step))
        session.do("ROLLBACK")
        moved = _moved(session, step, velocity="bdf2")
        x.append(moved.arrays["displacement"])
        if step == 1:
            _close(moved.arrays["velocity"], x[1] / (_TIMES[1] - _TIMES[0]))
        else:
            _close(moved.arrays["velocity"], _bdf2(x[-3:], _TIMES[step - 2 : step + 1]))
        session.do("COMMIT")
        session.take_up()


@suite("25.3")
def bossak_survives(stage: Stage) -> None:
    """bossak is Newmark's rule with β = 0.4225 and γ = 0.8, also after ROLLBACK and RESUME."""
    session = _stepping(stage, "bossak")
    x = v = a = np.zeros_like(session.parts[0].points)
    for step in (1, 2, 3):
        dt = _TIMES[step] - _TIMES[step - 1]
        session.do(_move(session, step))
        session.do("ROLLBACK")
        moved = _moved(session, step, velocity="bossak")
        now = moved.arrays["displacement"]
        new = (now - x - dt * v - dt**2 * (0.5 - 0.4225) * a) / (0.4225 * dt**2)
        x, v, a = now, v + dt * (0.2 * a + 0.8 * new), new
        _close(moved.arrays["velocity"], v)
        session.do("COMMIT")
        session.take_up()


@suite("25.3")
def levels_take_a_time(stage: Stage) -> None:
    """With time_levels a COMMIT of a step without a time is refused; a time in the COMMIT is sufficient."""
    session = _stepping(stage, "bdf2")
    session.do(_move(session, 1).without("time"))
    refused(session.ask("COMMIT"), "INVALID_ARGUMENT.VALUE", state="TRIAL", field="time")
    session.do(session.about("COMMIT", step=1, time=_TIMES[1]))


@suite("25.4")
def missing(stage: Stage) -> None:
    """Velocities whose time, levels or boundary_velocity is missing are refused, and the refusal names it."""
    session = _stepping(stage)
    move = _move(session, 1)
    timeless = move.without("time")
    for request, code, field in (
        (timeless.having(velocity="bdf1"), "INVALID_ARGUMENT.VALUE", "time"),
        (move.having(velocity="bdf2"), "FAILED_PRECONDITION", "velocity"),
        (move.having(velocity="bossak"), "FAILED_PRECONDITION", "velocity"),
        (move.having(velocity="tangent"), "INVALID_ARGUMENT.VALUE", "boundary_velocity"),
    ):
        refused(session.ask(request), code, state="READY", field=field)
    session.do(timeless)
    session.do("COMMIT")
    refused(session.ask(_move(session, 2, velocity="bdf1")), "FAILED_PRECONDITION", field="time")


@suite("25.5")
def conservation(stage: Stage) -> None:
    """The areas that the edges of a triangle sweep add up to the change of its area, in a first and a second step."""
    session = _stepping(stage)
    triangles, rest = SQUARE.triangles, SQUARE.points
    before = rest
    for step in (1, 2):
        moved = _moved(session, step, report="swept")
        after = rest + moved.arrays["displacement"]
        swept = moved.arrays["swept"]
        require(swept.shape == (3 * len(triangles),), f"{3 * len(triangles)} volumes", show(moved))
        change = _areas(after[triangles]) - _areas(before[triangles])
        same = np.abs(swept.reshape(-1, 3).sum(axis=1) - change).max() <= 1e-14 and np.abs(swept).max() >= 1e-6
        require(same, f"sums of {change[:3]} …", f"{swept[:9]} …")
        session.do("COMMIT")
        before = after


@suite("25.7")
def given_faces(stage: Stage) -> None:
    """The volumes of given edges are those of the cells' edges; wrong edges are refused with their row."""
    session = _stepping(stage)
    triangles = SQUARE.triangles
    edges = np.ascontiguousarray(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)[::-1], dtype="<i8")
    every = _moved(session, 1, report="swept").arrays["swept"]
    given = _moved(session, 1, report="swept", arrays={"swept_faces": edges}).arrays["swept"]
    _close(given, every[::-1])
    edges[4, 1] = len(SQUARE.points)
    wrong = _move(session, 1, report="swept", arrays={"swept_faces": edges})
    refused(session.ask(wrong), "INVALID_ARGUMENT", row=4)


def _areas(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """(m,) areas of triangles (m, 3, 2)."""
    a, b = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]
    return 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
