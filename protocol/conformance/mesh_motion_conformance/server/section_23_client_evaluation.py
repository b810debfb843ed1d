"""Section 23: the server has the boundary only; this client evaluates the field and sends the quality of its cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_conformance.case import Suite, Unmet, require
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.server.mesh import OUTER, SQUARE, WITHOUT_VOLUME, Part, Side, boundary
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.section_15_reports import digest
from mesh_motion_conformance.server.session import Session
from mesh_motion_conformance.server.stage import Stage
from mesh_motion_conformance.show import show
from mesh_motion_conformance.wire import Message

__all__ = ["functions", "suite"]

suite = Suite()

_REST = (1, 2, 3, 5, 7, 9, 10, 11)


_OF_THE_VOLUME = {"displacement": "relative", "correction": "enrichment", "sub_steps": "auto", "reduction": "greedy"}


@suite("23.1", {key.replace("_", "-"): (key, value) for key, value in _OF_THE_VOLUME.items()})
def settings(stage: Stage, key: str, value: str) -> None:
    """{0} has to leave the volume alone."""
    fields = {"dimension": 2, "settings": WITHOUT_VOLUME | {key: value}, "evaluation": "client"}
    reply = refused(stage.ask(Request("OPEN", fields)), "INVALID_ARGUMENT.SETTINGS", state="")
    require(key in str(reply.fields["details"]) + reply.fields["message"], f"an ERROR that names {key}", show(reply))


@suite("23.2")
def cells_with_nodes(stage: Stage) -> None:
    """Only the number of cells is uploaded."""
    session = stage.open(boundary(), settings=WITHOUT_VOLUME, evaluation="client")
    rows = SQUARE.triangles
    upload = Request("UPLOAD", session.address() | {"item": "cells", "name": "triangle"}, {"rows": rows})
    refused(session.ask(upload), "INVALID_ARGUMENT.SHAPE", state="NEW")


_EDGES = np.zeros((2, 2), "<i8")


@suite(
    "23.2",
    {
        "facets-of-3D": ("INVALID_ARGUMENT.VALUE", "triangle", np.zeros((2, 3), "<i8")),
        "facets-of-1-column": ("INVALID_ARGUMENT.SHAPE", "line", _EDGES[:, :1]),
        "facets-as-floats": ("INVALID_ARGUMENT.DTYPE", "line", _EDGES.astype("<f8")),
    },
)
def facets(stage: Stage, code: str, name: str, wrong: NDArray[Any]) -> None:
    """Facets are of the mesh's dimension less one."""
    session = stage.open(boundary(), settings=WITHOUT_VOLUME, evaluation="client")
    upload = Request("UPLOAD", session.address() | {"item": "facets", "name": name}, {"rows": wrong})
    refused(session.ask(upload), code, state="NEW")


def _outer_facets() -> NDArray[np.int64]:
    """(f, 2) edges of the square that belong to only one triangle, as rows of the uploaded nodes."""
    edges = np.concatenate([SQUARE.triangles[:, ends] for ends in ([0, 1], [1, 2], [2, 0])])
    _, first, counts = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    return np.asarray(np.searchsorted(OUTER, edges[first[counts == 1]]), dtype="<i8")


#: Two sides of the square slide, the one opposite the moving side is fixed.
_SLIDING = replace(
    boundary(),
    sides={
        "left": Side("moving", (0, 4, 6, 8)),
        "right": Side("fixed", (3, 5, 7, 11)),
        "walls": Side("slip", (1, 2, 9, 10)),
    },
)


def _with_facets(stage: Stage, rows: NDArray[np.int64]) -> Session:
    """A session with walls and the default motion, whose facets (f, 2) are uploaded."""
    session = stage.open(_SLIDING, settings={}, evaluation="client")
    session.upload()
    upload = Request("UPLOAD", session.address() | {"item": "facets", "name": "line"}, {"rows": rows})
    answered(session.ask(upload), "UPLOADED")
    return session


@suite("23.2")
def facets_twice(stage: Stage) -> None:
    """A facet that one partition has twice is refused."""
    rows = _outer_facets()
    session = _with_facets(stage, np.concatenate([rows, rows[:1]]))
    refused(session.ask("BUILD"), "INVALID_ARGUMENT.PARTITION", state="OPENING")


@suite("23.2")
def cells_near_walls(stage: Stage) -> None:
    """A BUILD with `reach` builds nothing until the cells near the moving side have come."""
    session, reach, wall = _asked_for_cells(stage)
    if not 0.0 < reach < 0.3 or wall.shape != (3, 4) or np.abs(wall[:, ::2]).max() > 0.0:
        raise Unmet("a reach within the first cells, and three edges at x = 0", f"{reach} {wall}")
    _build_with_cells(session, reach, _NEAR)


#: Behind the nodes of the boundary those inside; all triangles in rows of both.
_INSIDE = np.setdiff1d(np.arange(len(SQUARE.points)), OUTER)
_NEAR = np.asarray(np.argsort(np.concatenate([OUTER, _INSIDE]))[SQUARE.triangles], "<i8")


def _asked_for_cells(stage: Stage) -> tuple[Session, float, NDArray[np.float64]]:
    """A session whose nodes are all uploaded, with the reach and the wall's facets that BUILT asks for."""
    session = _with_facets(stage, _outer_facets())
    built = answered(session.ask(Request("BUILD", session.address() | {"reach": 0.0})), "BUILT")
    for item, rows in {"nodes": SQUARE.points[_INSIDE], "global_ids": np.asarray(_INSIDE[:, None], "<i8")}.items():
        answered(session.ask(Request("UPLOAD", session.address() | {"item": item}, {"rows": rows})), "UPLOADED")
    return session, built.fields["reach"], built.arrays["wall"]


def _near_cells(session: Session, name: str, rows: NDArray[Any]) -> Message:
    """The answer to an UPLOAD of cells near the moving side."""
    fields = session.address() | {"item": "near_cells", "name": name}
    return session.ask(Request("UPLOAD", fields, {"rows": rows}))


def _build_with_cells(session: Session, reach: float, rows: NDArray[np.int64]) -> None:
    """Upload these cells (m, 3) and check that BUILT asks for no more."""
    answered(_near_cells(session, "triangle", rows), "UPLOADED")
    built = answered(session.ask(Request("BUILD", session.address() | {"reach": reach})), "BUILT")
    require(not built.fields.get("reach", 0.0), "a mesh that is built: its cells are not thin", show(built))


@suite(
    "23.2",
    {
        "near-cells-of-3D": ("INVALID_ARGUMENT.VALUE", "tetrahedron", np.zeros((2, 4), "<i8")),
        "near-cells-of-2-columns": ("INVALID_ARGUMENT.SHAPE", "triangle", _NEAR[:, :2]),
        "near-cells-as-floats": ("INVALID_ARGUMENT.DTYPE", "triangle", _NEAR.astype("<f8")),
    },
)
def wrong_near_cells(stage: Stage, code: str, name: str, wrong: NDArray[Any]) -> None:
    """Refused cells near a wall can be sent again."""
    session, reach, _ = _asked_for_cells(stage)
    refused(_near_cells(session, name, wrong), code, state="OPENING")
    _build_with_cells(session, reach, _NEAR)


@suite("23.2")
def near_cells_of_no_node(stage: Stage) -> None:
    """A cell near a wall with a node that was not uploaded is named."""
    session, reach, _ = _asked_for_cells(stage)
    answered(_near_cells(session, "triangle", np.concatenate([_NEAR[:-1], [[0, 1, 16]]])), "UPLOADED")
    reply = refused(session.ask(Request("BUILD", session.address() | {"reach": reach})), "INVALID_ARGUMENT.MESH")
    require("16" in reply.fields["message"], "an ERROR that names the node 16", show(reply))


@suite("23.2")
def near_cells_are_missing(stage: Stage) -> None:
    """A node on the moving side without a cell is named; with the missing cells the mesh is built."""
    session, reach, _ = _asked_for_cells(stage)
    last = np.isin(_NEAR, OUTER.index(8)).any(axis=1)
    answered(_near_cells(session, "triangle", _NEAR[~last]), "UPLOADED")
    build = Request("BUILD", session.address() | {"reach": reach})
    reply = refused(session.ask(build), "INVALID_ARGUMENT.MESH", state="OPENING")
    require(reply.fields["details"].get("global_id") == 8, "an ERROR that names the node 8", show(reply))
    _build_with_cells(session, reach, _NEAR[last])


@suite(
    "23.2",
    {
        "reach-negative": (-1.0,),
        "reach-of-NaN": (np.nan,),
        "reach-infinite": (np.inf,),
        "reach-larger-than-asked": (0.5,),
        "reach-smaller": (1e-12,),
    },
)
def wrong_reaches(stage: Stage, wrong: float) -> None:
    """A reach that no BUILT asked for is refused."""
    session, reach, _ = _asked_for_cells(stage)
    build = Request("BUILD", session.address() | {"reach": wrong})
    code = "VALUE" if np.isfinite(wrong) else "NONFINITE"
    refused(session.ask(build), f"INVALID_ARGUMENT.{code}", state="OPENING")
    _build_with_cells(session, reach, _NEAR)


@suite("23.2")
def build_without_reach(stage: Stage) -> None:
    """A client that sends no cells near walls is warned."""
    session = _with_facets(stage, _outer_facets())
    built = session.do("BUILD")
    if not any("partition 0" in warning for warning in built.fields["mesh"]["warnings"]):
        raise Unmet("a warning that names partition 0", show(built))


@suite("23.3")
def nodes_slide(stage: Stage) -> None:
    """If the facets of the boundary are uploaded, nodes of slip patches slide along their side."""
    session = _with_facets(stage, _outer_facets())
    session.do("BUILD")
    displacement = session.do("MOVE").arrays["displacement"]
    along, across = np.abs(displacement[[1, 2, 9, 10]]).T
    if across.max() > 0.0 or along.min() <= 0.0:
        raise Unmet("displacements along x", str(displacement))


@suite(
    "23.3",
    {
        "slip-without-facets": (boundary(Side("slip", _REST)),),
        "nothing-fixed": (boundary(Side("moving", _REST)),),
        "node-on-no-patch": (boundary(Side("fixed", _REST[:-1])),),
    },
)
def boundaries(stage: Stage, part: Part) -> None:
    """BUILD is refused where the boundary does not determine the motion."""
    session = stage.open(part, settings=WITHOUT_VOLUME, evaluation="client")
    session.upload()
    refused(session.ask("BUILD"), "INVALID_ARGUMENT.MESH", state="OPENING")


@suite("23.4", {"increments": ("frame", "committed"), "faces": ("report", "faces")})
def moves(stage: Stage, field: str, wrong: str) -> None:
    """MOVE's {0} is not {1}."""
    session = stage.judging("READY")
    refused(session.ask(session.request("MOVE").having(**{field: wrong})), "INVALID_ARGUMENT.VALUE", state="READY")


def functions(moved: Message, nodes: Sequence[int]) -> NDArray[np.float64]:
    """Basis functions of MOVED's coefficients at nodes of the square; the field of a few nodes is one sum."""
    (total,) = moved.fields["sums"]
    points, centres = SQUARE.points[list(nodes)], moved.arrays["centres"]
    if total["basis"] != "wendland-c2" or total["centres"] != len(centres) or len(moved.arrays["boxes"]):
        raise Unmet("one sum of the basis asked for, without a spline", show(moved))
    xi = np.linalg.norm(points[:, None] - centres[None], axis=2) / total["radius"]
    return np.asarray(np.maximum(1.0 - xi, 0.0) ** 4 * (4.0 * xi + 1.0))


@suite("23.4")
def field_meets_the_boundary(stage: Stage) -> None:
    """The sum of MOVED's field is, at the nodes with a role, their displacement."""
    moved = stage.judging("READY").do("MOVE")
    field = functions(moved, OUTER) @ moved.arrays["coefficients"]
    error = float(np.abs(field - moved.arrays["displacement"]).max())
    require(error < 1e-9, "the displacement of the boundary", f"another one by {error:.2g}")


@suite("23.4")
def coefficients_alone(stage: Stage) -> None:
    """With field_known MOVED has the coefficients, and no other part of the field."""
    session = stage.judging("READY")
    whole = session.do("MOVE")
    moved = answered(session.ask(session.request("MOVE").having(field_known=True)), "MOVED")
    if moved.fields.get("sums") or {"centres", "boxes"} & set(moved.arrays):
        raise Unmet("no sums, centres or boxes", show(moved))
    if moved.arrays["coefficients"].tobytes() != whole.arrays["coefficients"].tobytes():
        raise Unmet("the coefficients of the same MOVE before", "others")


@suite("23.6")
def further_bins_are_asked_for(stage: Stage) -> None:
    """JUDGED's questions are those that are still open."""
    session = stage.judging()
    judged = answered(session.ask(session.judge(metrics=("size", "skew"))), "JUDGED")
    if judged.fields["questions"] != [{"metric": "size-skew", "way": []}] or judged.fields["quality"]:
        raise Unmet("a question about size-skew, and no quality", show(judged))


@suite("23.6")
def quality_is_reported(stage: Stage) -> None:
    """JUDGED has the quality once all questions are answered."""
    session = stage.judging()
    judged = answered(session.ask("JUDGE"), "JUDGED")
    found = judged.fields["quality"].get("corrected", {})
    same = dict.fromkeys(("min", "p1", "p5", "p50"), 0.5)
    given = {name: found.get("metric", {}).get(name) for name in same}
    if judged.fields["questions"] or given != same or found["cells"] != len(SQUARE.triangles):
        raise Unmet(f"{len(SQUARE.triangles)} cells of quality 0.5", show(judged))
    if found["worst"][0]["type"] != "triangle" or found["worst"][0]["cell"] != 0:
        raise Unmet("triangle 0 as the worst cell", str(found["worst"][0]))


@suite("23.6")
def bins_that_do_not_add_up(stage: Stage) -> None:
    """The bins of all values contain all cells."""
    session = stage.judging()
    judge = session.judge()
    wrong = replace(judge, arrays=judge.arrays | {"bins": judge.arrays["bins"] - [0, 0, 1]})
    refused(session.ask(wrong), "INVALID_ARGUMENT", state="TRIAL")


def _correcting(stage: Stage) -> Session:
    """A session with a correction whose client has the cells, in TRIAL."""
    chosen = {"correction": "optimised", "correction_target": "threshold", "quality_threshold": 0.3}
    session = stage.open(boundary(), settings=WITHOUT_VOLUME | chosen, evaluation="client")
    session.upload()
    session.do("BUILD")
    session.do("MOVE")
    return session


def _squeezed(positions: NDArray[np.float64], node: int) -> NDArray[np.float64]:
    """The positions, with one node moved near an edge of one of its triangles."""
    triangle = next(cell for cell in SQUARE.triangles.tolist() if node in cell)
    others = [corner for corner in triangle if corner != node]
    moved = positions.copy()
    moved[node] = 0.15 * positions[node] + 0.85 * positions[others].mean(axis=0)
    return moved


@suite("23.7")
def bad_cells_are_corrected(stage: Stage) -> None:
    """If the quality is below the threshold, JUDGED asks for a region, and CORRECTED has the positions of its nodes."""
    session = _correcting(stage)
    judged = answered(session.ask(session.judge(0.25)), "JUDGED")
    region = judged.fields["region"]
    if set(region) != {"metric", "below", "rings"} or not 0.3 <= region["below"] <= 0.5:
        raise Unmet("a region of the cells below the threshold of 0.3, or a little more", show(judged))
    correct = session.correct(region["below"])
    inner = next(node for node in range(len(SQUARE.points)) if node not in OUTER)
    arrays = correct.arrays | {"positions": _squeezed(SQUARE.points, inner)}
    corrected = answered(session.ask(replace(correct, arrays=arrays)), "CORRECTED")
    nodes = corrected.arrays["nodes"]
    if corrected.fields["region"] or len(nodes) != len(corrected.arrays["displacement"]) or set(nodes) & set(OUTER):
        raise Unmet("displacements of nodes that are not on the boundary, and no region", show(corrected))
    refused(session.ask("COMMIT"), "FAILED_PRECONDITION.STATE", state="TRIAL")
    quality = answered(session.ask("JUDGE"), "JUDGED").fields["quality"]
    lowest = [quality[which]["metric"]["min"] for which in ("standard", "corrected")]
    require(lowest == [0.25, 0.5], "the quality before and after the correction", str(lowest))
    answered(session.ask("COMMIT"), "COMMITTED")
    if not answered(session.ask("FETCH"), "FETCHED").fields["region"]:
        raise Unmet("a region in FETCHED of corrected coordinates", "none")


@suite("23.7")
def larger_region(stage: Stage) -> None:
    """If nodes of a region have cells that were not sent, the server asks for a larger region."""
    session = _correcting(stage)
    region = answered(session.ask(session.judge(0.25)), "JUDGED").fields["region"]
    correct = session.correct(region["below"], interior=0)
    nodes = correct.arrays["nodes"].copy()
    inner = [node for node in range(len(SQUARE.points)) if node not in OUTER]
    nodes[inner, 1] = 0
    arrays = correct.arrays | {"nodes": nodes, "positions": _squeezed(SQUARE.points, inner[0])}
    corrected = answered(session.ask(replace(correct, arrays=arrays)), "CORRECTED")
    if not corrected.fields["region"].get("rings", 0) > region["rings"]:
        raise Unmet(f"a region of more than {region['rings']} rings", show(corrected))


@suite("23.7")
def region_that_is_no_region(stage: Stage) -> None:
    """Corners that are not nodes are refused."""
    session = _correcting(stage)
    correct = session.correct()
    wrong = replace(correct, arrays=correct.arrays | {"corners": correct.arrays["corners"] + 1000})
    refused(session.ask(wrong), "INVALID_ARGUMENT", state="TRIAL")


@suite("23.8")
def commit_before_a_judge(stage: Stage) -> None:
    """COMMIT before a JUDGED with quality is refused."""
    session = stage.judging()
    refused(session.ask("COMMIT"), "FAILED_PRECONDITION.STATE", state="TRIAL")


@suite("23.8")
def bad_quality_is_refused(stage: Stage) -> None:
    """A trial of inverted cells is refused by its JUDGE, and cannot be committed."""
    session = stage.judging()
    reply = refused(session.ask(session.judge(-0.5)), "FAILED_PRECONDITION.QUALITY", state="TRIAL")
    details = reply.fields["details"]
    if details.get("best") != -0.5 or details.get("fraction", 0) is not None or not details.get("worst"):
        raise Unmet("best -0.5, a fraction of nil, the worst cells", show(reply))
    refused(session.ask("COMMIT"), "FAILED_PRECONDITION.STATE", state="TRIAL")


@suite("23.9")
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
        require(after.arrays[name].tobytes() == array.tobytes(), f"the same {name} after RESUME", "others")


@suite("8")
def JUDGE_where_the_server_judges(stage: Stage) -> None:
    """JUDGE and CORRECT are refused in sessions whose client does not evaluate the field."""
    for state in ("NEW", "READY", "TRIAL"):
        session = stage.session(state)
        for request in ("JUDGE", "CORRECT"):
            refused(session.ask(request), "FAILED_PRECONDITION.STATE", state=state)
