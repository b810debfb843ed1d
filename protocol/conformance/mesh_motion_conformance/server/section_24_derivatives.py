"""Section 24: derivatives."""

from __future__ import annotations

import numpy as np

from mesh_motion_conformance.case import require
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.server.mesh import OUTER
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.section_23_client_evaluation import functions
from mesh_motion_conformance.server.session import Session
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.show import show


def _asked(session: Session, kind: str, name: str, values: np.ndarray, what: str = "committed") -> np.ndarray:
    return session.do(session.about(kind, {name: values}, what=what)).arrays[name]


@suite("24.1")
def transpose(stage: Stage) -> None:
    """Σ w · (J v) is Σ (Jᵀ w) · v, at the trial and at the committed state."""
    session = stage.session("TRIAL")
    numbers = np.random.default_rng(24)
    nodes, moving = session.parts[0].points.shape, session.rows().shape
    for what in ("committed", "trial"):
        v, w = numbers.standard_normal(moving), numbers.standard_normal(nodes)
        forth, back = _asked(session, "TANGENT", "velocity", v, what), _asked(session, "COTANGENT", "weights", w, what)
        one, other = float(np.sum(w * forth)), float(np.sum(back * v))
        close = abs(one - other) <= 1e-9 * float(np.sum(np.abs(w * forth)) + np.sum(np.abs(back * v)))
        require(close, "the same sum from both sides", f"{one} and {other}")


@suite("24.1")
def moving_nodes(stage: Stage) -> None:
    """The velocities of the moving nodes are those that TANGENT has given."""
    session = stage.session("READY")
    v = session.rows(size=1.0)
    found = _asked(session, "TANGENT", "velocity", v)[session.parts[0].moving]
    require(np.abs(found - v).max() <= 1e-12, f"{v[0]} at the first moving node", f"{found[0]}")


@suite("24.3")
def columns(stage: Stage) -> None:
    """Two vectors in one request are answered as each of them is."""
    session = stage.session("READY")
    one, other = session.rows(size=1.0), session.rows(size=0.5)
    both = _asked(session, "TANGENT", "velocity", np.hstack([one, other]))
    alone = np.hstack([_asked(session, "TANGENT", "velocity", each) for each in (one, other)])
    same = both.shape == alone.shape and np.abs(both - alone).max() <= 1e-12
    require(same, "the columns of both", f"shape {both.shape}")
    for wrong in (one[:, :1], one[:-1], one[:, :0]):
        refused(session.ask(session.about("TANGENT", {"velocity": wrong})), "INVALID_ARGUMENT.SHAPE")


@suite("24.5")
def nothing_changes(stage: Stage) -> None:
    """Derivatives do not change the bytes of a MOVE's answer, and do not remove the trial."""
    session = stage.session("READY")
    before = session.do("MOVE")
    _asked(session, "TANGENT", "velocity", session.rows(), "trial")
    _asked(session, "COTANGENT", "weights", session.parts[0].points, "trial")
    after = session.do("MOVE")
    same = all(before.arrays[name].tobytes() == after.arrays[name].tobytes() for name in before.arrays)
    require(same, "the same arrays", show(after))
    _asked(session, "COTANGENT", "weights", session.parts[0].points, "trial")
    session.do("COMMIT")


@suite("24.7")
def field_of_the_tangent(stage: Stage) -> None:
    """With evaluation by the client the velocities of the boundary are those of the field of TANGENT_FOUND."""
    session = stage.judging("READY")
    moved, v = session.do("MOVE"), session.rows(size=1.0)
    found = session.do(_at_trial(session, "TANGENT", velocity=v)).arrays
    error = np.abs(functions(moved, OUTER) @ found["coefficients"] - found["velocity"]).max()
    same = error < 1e-9 and np.abs(found["velocity"][session.parts[0].moving] - v).max() <= 1e-12
    require(same, "the velocities of the boundary", f"others by {error:.2g}")


@suite("24.8")
def counted_coefficients(stage: Stage) -> None:
    """There COTANGENT is the transpose: the weights of the other nodes come as weights of the coefficients."""
    session = stage.judging("READY")
    moved, v = session.do("MOVE"), session.rows(size=1.0)
    inner = functions(moved, sorted(set(range(16)) - set(OUTER)))
    numbers = np.random.default_rng(248)
    weights, others = numbers.standard_normal((len(OUTER), 2)), numbers.standard_normal((len(inner), 2))
    found = session.do(_at_trial(session, "TANGENT", velocity=v)).arrays
    one = np.sum(weights * found["velocity"]) + np.sum(others * (inner @ found["coefficients"]))
    ask = _at_trial(session, "COTANGENT", weights=weights, coefficients=inner.T @ others)
    other = np.sum(session.do(ask).arrays["weights"] * v)
    require(abs(one - other) < 1e-9 * (1.0 + abs(one)), "the same sum from both sides", f"{one} and {other}")
    refused(session.ask(_at_trial(session, "COTANGENT", weights=weights)), "INVALID_ARGUMENT.VALUE", state="TRIAL")


def _at_trial(session: Session, kind: str, **arrays: np.ndarray) -> Request:
    return session.about(kind, arrays, what="trial")


@suite("24.2")
def no_trial(stage: Stage) -> None:
    """Derivatives at the trial are refused without a trial."""
    session = stage.session("READY")
    request = _at_trial(session, "TANGENT", velocity=session.rows())
    refused(session.ask(request), "FAILED_PRECONDITION.STATE", state="READY")


@suite("24.6")
def no_derivative(stage: Stage) -> None:
    """BUILT reports a method without derivatives, and the requests are refused with the key."""
    session = stage.open(settings={"displacement": "relative"})
    answered(session.build(), "BUILT", derivatives=False)
    for kind in ("TANGENT", "COTANGENT"):
        refused(session.ask(kind), "FAILED_PRECONDITION", setting="displacement")
