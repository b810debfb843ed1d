"""Section 23: the server has the boundary only; this client evaluates the field and tells what the cells are like."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_conformance.case import Case, Suite, Unmet
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.server.mesh import OUTER, SQUARE, WITHOUT_VOLUME, Part, Side, boundary
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.section_15_reports import digest
from mesh_motion_conformance.server.stage import Stage
from mesh_motion_conformance.show import show
from mesh_motion_conformance.wire import Message

__all__ = ["suite"]

suite = Suite()

_REST = (1, 2, 3, 5, 7, 9, 10, 11)


@suite.family
def settings() -> Iterator[Case]:
    """OPEN is refused unless the settings leave the volume alone."""
    others = {"displacement": "relative", "correction": "optimised", "sub_steps": "auto",
              "boundary_layer_thickness": None, "reduction": "greedy"}  # fmt: skip

    def run(key: str, value: Any) -> Callable[[Stage], None]:
        def other(stage: Stage) -> None:
            fields = {"dimension": 2, "settings": WITHOUT_VOLUME | {key: value}, "evaluation": "client"}
            reply = refused(stage.ask(Request("OPEN", fields)), "INVALID_ARGUMENT.SETTINGS", state="")
            if key not in str(reply.fields["details"]) + reply.fields["message"]:
                raise Unmet(f"an ERROR that names {key}", show(reply))

        return other

    for key, value in others.items():
        yield Case("23.1", key.replace("_", "-"), f"{key} has to leave the volume alone", run(key, value))


@suite("23.2")
def cells_with_nodes(stage: Stage) -> None:
    """Of cells only the number is uploaded."""
    session = stage.open(boundary(), settings=WITHOUT_VOLUME, evaluation="client")
    rows = SQUARE.triangles
    upload = Request("UPLOAD", session.address() | {"item": "cells", "name": "triangle"}, {"rows": rows})
    refused(session.ask(upload), "INVALID_ARGUMENT.SHAPE", state="NEW")
    session.discard()


@suite.family
def boundaries() -> Iterator[Case]:
    """BUILD is refused where the boundary does not determine the motion."""
    parts = {
        "slip": boundary(Side("slip", _REST)),
        "nothing-fixed": boundary(Side("moving", _REST)),
        "node-on-no-patch": boundary(Side("fixed", _REST[:-1])),
    }

    def run(part: Part) -> Callable[[Stage], None]:
        def unusable(stage: Stage) -> None:
            session = stage.open(part, settings=WITHOUT_VOLUME, evaluation="client")
            session.upload()
            refused(session.ask("BUILD"), "INVALID_ARGUMENT.MESH", state="OPENING")
            session.discard()

        return unusable

    for name, part in parts.items():
        yield Case("23.3", name, "BUILD is refused where the boundary does not determine the motion", run(part))


@suite.family
def moves() -> Iterator[Case]:
    """frame is "reference", report is empty."""

    def run(**fields: str) -> Callable[[Stage], None]:
        def other(stage: Stage) -> None:
            session = stage.judging("READY")
            refused(session.ask(session.request("MOVE").having(**fields)), "INVALID_ARGUMENT.VALUE", state="READY")

        return other

    yield Case("23.4", "increments", "MOVE's frame is reference", run(frame="committed"))
    yield Case("23.4", "faces", "MOVE's report is empty", run(report="faces"))


def _value(moved: Message) -> NDArray[np.float64]:
    """The field of a few nodes, one sum, where they are."""
    (total,) = moved.fields["sums"]
    points, centres = SQUARE.points[list(OUTER)], moved.arrays["centres"]
    if total["basis"] != "wendland-c2" or total["centres"] != len(centres) or len(moved.arrays["boxes"]):
        raise Unmet("one sum of the basis asked for, without a spline", show(moved))
    xi = np.linalg.norm(points[:, None] - centres[None], axis=2) / total["radius"]
    return np.asarray((np.maximum(1.0 - xi, 0.0) ** 4 * (4.0 * xi + 1.0)) @ moved.arrays["coefficients"])


@suite("23.4")
def field_meets_the_boundary(stage: Stage) -> None:
    """The sum of MOVED's field is, at the nodes with a role, their displacement."""
    moved = stage.judging("READY").do("MOVE")
    error = float(np.abs(_value(moved) - moved.arrays["displacement"]).max())
    if not error < 1e-9:
        raise Unmet("the displacement of the boundary", f"another one by {error:.2g}")


@suite("23.6")
def further_bins_are_asked_for(stage: Stage) -> None:
    """JUDGED's questions are those that are missing."""
    session = stage.judging()
    judged = answered(session.ask(session.judge(metrics=("size", "skew"))), "JUDGED")
    if judged.fields["questions"] != [{"metric": "size-skew", "way": []}] or judged.fields["quality"]:
        raise Unmet("a question about size-skew, and no quality", show(judged))


@suite("23.6")
def quality_is_told(stage: Stage) -> None:
    """JUDGED has the quality once all is known."""
    session = stage.judging()
    judged = answered(session.ask("JUDGE"), "JUDGED")
    found = judged.fields["quality"].get("corrected", {})
    same = dict.fromkeys(("min", "p1", "p5", "p50"), 0.5)
    told = {name: found.get("metric", {}).get(name) for name in same}
    if judged.fields["questions"] or told != same or found["cells"] != len(SQUARE.triangles):
        raise Unmet(f"{len(SQUARE.triangles)} cells of quality 0.5", show(judged))
    if found["worst"][0]["type"] != "triangle" or found["worst"][0]["cell"] != 0:
        raise Unmet("triangle 0 as the worst cell", str(found["worst"][0]))


@suite("23.6")
def bins_that_do_not_add_up(stage: Stage) -> None:
    """The bins of all values hold all cells."""
    session = stage.judging()
    judge = session.judge()
    wrong = replace(judge, arrays=judge.arrays | {"bins": judge.arrays["bins"] - [0, 0, 1]})
    refused(session.ask(wrong), "INVALID_ARGUMENT", state="TRIAL")


@suite("23.7")
def commit_before_a_judge(stage: Stage) -> None:
    """COMMIT before a JUDGED with quality is refused."""
    session = stage.judging()
    refused(session.ask("COMMIT"), "FAILED_PRECONDITION.STATE", state="TRIAL")


@suite("23.7")
def bad_quality_is_refused(stage: Stage) -> None:
    """A trial of inverted cells is refused by its JUDGE, and cannot be committed."""
    session = stage.judging()
    reply = refused(session.ask(session.judge(-0.5)), "FAILED_PRECONDITION.QUALITY", state="TRIAL")
    details = reply.fields["details"]
    if details.get("best") != -0.5 or details.get("fraction", 0) is not None or not details.get("worst"):
        raise Unmet("best -0.5, a fraction of nil, the worst cells", show(reply))
    refused(session.ask("COMMIT"), "FAILED_PRECONDITION.STATE", state="TRIAL")


@suite("23.8")
def field_survives(stage: Stage) -> None:
    """After RESUME FETCH gives the committed field and nodes bit for bit; the digest is over both."""
    session = stage.judging()
    session.do("JUDGE")
    committed = session.do("COMMIT")
    before = session.do("FETCH")
    points, rows = before.arrays["points"], before.arrays["coefficients"]
    if committed.fields["digest"] != digest(session.step, np.concatenate([points, rows])):
        raise Unmet("the digest of section 16", committed.fields["digest"].hex())
    session.resume()
    session.join()
    after = session.do("FETCH")
    for name, array in before.arrays.items():
        if after.arrays[name].tobytes() != array.tobytes():
            raise Unmet(f"the same {name} after RESUME", "others")


@suite("8")
def JUDGE_where_the_server_judges(stage: Stage) -> None:
    """JUDGE is refused where the client does not evaluate the field."""
    for state in ("NEW", "READY", "TRIAL"):
        session = stage.session(state)
        refused(session.ask("JUDGE"), "FAILED_PRECONDITION.STATE", state=state)
