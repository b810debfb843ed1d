"""Section 23: the server has the boundary only; this client evaluates the field and sends the quality of its cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_conformance.case import require
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.server.mesh import OUTER, SQUARE, WITHOUT_VOLUME, Side, boundary
from mesh_motion_conformance.server.section_14_settings import refused_settings
from mesh_motion_conformance.server.section_15_reports import digest
from mesh_motion_conformance.server.session import Session
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.show import show
from mesh_motion_conformance.wire import Message

__all__ = ["functions"]

_REST = (1, 2, 3, 5, 7, 9, 10, 11)
_OF_THE_VOLUME = {"displacement": "relative", "correction": "enrichment", "sub_steps": "auto", "reduction": "greedy"}


@suite("23.1", {key.replace("_", "-"): (key, value) for key, value in _OF_THE_VOLUME.items()})
def settings(stage: Stage, key: str, value: str) -> None:
    """{0} has to leave the volume alone."""
    refused_settings(stage, key, WITHOUT_VOLUME | {key: value}, evaluation="client")


@suite("23.2")
def cells_with_nodes(stage: Stage) -> None:
    """Only the number of cells is uploaded."""
    session = stage.outer()
    upload = session.uploading(SQUARE.triangles, item="cells", name="triangle")
    refused(session.ask(upload), "INVALID_ARGUMENT.SHAPE", state="NEW")


_EDGES = np.zeros((2, 2), "<i8")
_WRONG_FACETS = {
    "facets-of-3D": ("INVALID_ARGUMENT.VALUE", "triangle", np.zeros((2, 3), "<i8")),
    "facets-of-1-column": ("INVALID_ARGUMENT.SHAPE", "line", _EDGES[:, :1]),
    "facets-as-floats": ("INVALID_ARGUMENT.DTYPE", "line", _EDGES.astype("<f8")),
}


@suite("23.2", _WRONG_FACETS)
def facets(stage: Stage, code: str, name: str, wrong: NDArray[Any]) -> None:
    """Facets are of the mesh's dimension less one."""
    session = stage.outer()
    refused(session.ask(session.uploading(wrong, item="facets", name=name)), code, state="NEW")


def _outer_facets() -> NDArray[np.int64]:
    """(f, 2) edges of the square that belong to only one triangle, as rows of the uploaded nodes."""
    edges = np.concatenate([SQUARE.triangles[:, ends] for ends in ([0, 1], [1, 2], [2, 0])])
    _, first, counts = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    return np.asarray(np.searchsorted(OUTER, edges[first[counts == 1]]), dtype="<i8")


#: Two sides of the square slide, the one opposite the moving side is fixed.
_SIDES = {"left": ("moving", (0, 4, 6, 8)), "right": ("fixed", (3, 5, 7, 11)), "walls": ("slip", (1, 2, 9, 10))}
_SLIDING = replace(boundary(), sides={name: Side(*side) for name, side in _SIDES.items()})


def _with_facets(stage: Stage, rows: NDArray[np.int64]) -> Session:
    """A session with walls and the default motion, whose facets (f, 2) are uploaded."""
    session = stage.outer(_SLIDING, {})
    session.upload()
    session.do(session.uploading(rows, item="facets", name="line"))
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
    right = 0.0 < reach < 0.3 and wall.shape == (3, 4) and np.abs(wall[:, ::2]).max() <= 0.0
    require(right, "a reach within the first cells, and three edges at x = 0", f"{reach} {wall}")
    _build_with_cells(session, reach, _NEAR)


#: Behind the nodes of the boundary those inside; all triangles in rows of both.
_INSIDE = np.setdiff1d(np.arange(len(SQUARE.points)), OUTER)
_NEAR = np.asarray(np.argsort(np.concatenate([OUTER, _INSIDE]))[SQUARE.triangles], "<i8")


def _asked_for_cells(stage: Stage) -> tuple[Session, float, NDArray[np.float64]]:
    """A session whose nodes are all uploaded, with the reach and the wall's facets that BUILT asks for."""
    session = _with_facets(stage, _outer_facets())
    built = session.do(session.about("BUILD", reach=0.0))
    for item, rows in {"nodes": SQUARE.points[_INSIDE], "global_ids": np.asarray(_INSIDE[:, None], "<i8")}.items():
        session.do(session.uploading(rows, item=item))
    return session, built.fields["reach"], built.arrays["wall"]


def _near_cells(session: Session, name: str, rows: NDArray[Any]) -> Message:
    """The answer to an UPLOAD of cells near the moving side."""
    return session.ask(session.uploading(rows, item="near_cells", name=name))


def _build_with_cells(session: Session, reach: float, rows: NDArray[np.int64]) -> None:
    """Upload these cells (m, 3) and check that BUILT asks for no more."""
    answered(_near_cells(session, "triangle", rows), "UPLOADED")
    built = session.do(session.about("BUILD", reach=reach))
    require(not built.fields.get("reach", 0.0), "a mesh that is built: its cells are not thin", show(built))


_WRONG_CELLS = {
    "near-cells-of-3D": ("INVALID_ARGUMENT.VALUE", "tetrahedron", np.zeros((2, 4), "<i8")),
    "near-cells-of-2-columns": ("INVALID_ARGUMENT.SHAPE", "triangle", _NEAR[:, :2]),
    "near-cells-as-floats": ("INVALID_ARGUMENT.DTYPE", "triangle", _NEAR.astype("<f8")),
}


@suite("23.2", _WRONG_CELLS)
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
    reply = refused(session.ask(session.about("BUILD", reach=reach)), "INVALID_ARGUMENT.MESH")
    require("16" in reply.fields["message"], "an ERROR that names the node 16", show(reply))


@suite("23.2")
def near_cells_are_missing(stage: Stage) -> None:
    """A node on the moving side without a cell is named; with the missing cells the mesh is built."""
    session, reach, _ = _asked_for_cells(stage)
    last = np.isin(_NEAR, OUTER.index(8)).any(axis=1)
    answered(_near_cells(session, "triangle", _NEAR[~last]), "UPLOADED")
    refused(session.ask(session.about("BUILD", reach=reach)), "INVALID_ARGUMENT.MESH", state="OPENING", global_id=8)
    _build_with_cells(session, reach, _NEAR[last])


_WRONG_REACHES = {"negative": -1.0, "of-NaN": np.nan, "infinite": np.inf, "larger-than-asked": 0.5, "smaller": 1e-12}


@suite("23.2", {f"reach-{name}": (reach,) for name, reach in _WRONG_REACHES.items()})
def wrong_reaches(stage: Stage, wrong: float) -> None:
    """A reach that no BUILT asked for is refused."""
    session, reach, _ = _asked_for_cells(stage)
    code = "VALUE" if np.isfinite(wrong) else "NONFINITE"
    refused(session.ask(session.about("BUILD", reach=wrong)), f"INVALID_ARGUMENT.{code}", state="OPENING")
    _build_with_cells(session, reach, _NEAR)


@suite("23.2")
def build_without_reach(stage: Stage) -> None:
    """A client that sends no cells near walls is warned."""
    session = _with_facets(stage, _outer_facets())
    built = session.do("BUILD")
    named = any("partition 0" in warning for warning in built.fields["mesh"]["warnings"])
    require(named, "a warning that names partition 0", show(built))


@suite("23.3")
def nodes_slide(stage: Stage) -> None:
    """If the facets of the boundary are uploaded, nodes of slip patches slide along their side."""
    session = _with_facets(stage, _outer_facets())
    session.do("BUILD")
    displacement = session.do("MOVE").arrays["displacement"]
    along, across = np.abs(displacement[[1, 2, 9, 10]]).T
    require(across.max() <= 0.0 and along.min() > 0.0, "displacements along x", str(displacement))


_OPEN_BOUNDARIES = {
    "slip-without-facets": ("slip", _REST),
    "nothing-fixed": ("moving", _REST),
    "node-on-no-patch": ("fixed", _REST[:-1]),
}


@suite("23.3", _OPEN_BOUNDARIES)
def boundaries(stage: Stage, role: str, nodes: tuple[int, ...]) -> None:
    """BUILD is refused where the boundary does not determine the motion."""
    session = stage.outer(boundary(Side(role, nodes)))
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
    plain = total["basis"] == "wendland-c2" and total["centres"] == len(centres) and not len(moved.arrays["boxes"])
    require(plain, "one sum of the basis asked for, without a spline", show(moved))
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
    moved = session.do(session.request("MOVE").having(field_known=True))
    bare = not moved.fields.get("sums") and not {"centres", "boxes"} & set(moved.arrays)
    require(bare, "no sums, centres or boxes", show(moved))
    same = moved.arrays["coefficients"].tobytes() == whole.arrays["coefficients"].tobytes()
    require(same, "the coefficients of the same MOVE before", "others")


@suite("23.6")
def further_bins_are_asked_for(stage: Stage) -> None:
    """JUDGED's questions are those that are still open."""
    session = stage.judging()
    questions = [{"metric": "size-skew", "way": []}]
    session.do(session.judge(metrics=("size", "skew")), questions=questions, quality={})


@suite("23.6")
def quality_is_reported(stage: Stage) -> None:
    """JUDGED has the quality once all questions are answered."""
    session = stage.judging()
    judged = session.do("JUDGE", questions=[])
    found = judged.fields["quality"].get("corrected", {})
    values = {found["metric"][name] for name in ("min", "p1", "p5", "p50")}
    cells = len(SQUARE.triangles)
    require(values == {0.5} and found["cells"] == cells, f"{cells} cells of quality 0.5", show(judged))
    worst = found["worst"][0]
    require((worst["type"], worst["cell"]) == ("triangle", 0), "triangle 0 as the worst cell", str(worst))


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
    session = stage.outer(settings=WITHOUT_VOLUME | chosen)
    session.build()
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
    judged = session.do(session.judge(0.25))
    region = judged.fields["region"]
    right = set(region) == {"metric", "below", "rings"} and 0.3 <= region["below"] <= 0.5
    require(right, "a region of the cells below the threshold of 0.3, or a little more", show(judged))
    correct = session.correct(region["below"])
    inner = next(node for node in range(len(SQUARE.points)) if node not in OUTER)
    arrays = correct.arrays | {"positions": _squeezed(SQUARE.points, inner)}
    corrected = session.do(replace(correct, arrays=arrays), region={})
    nodes = corrected.arrays["nodes"]
    inside = len(nodes) == len(corrected.arrays["displacement"]) and not set(nodes) & set(OUTER)
    require(inside, "displacements of nodes that are not on the boundary", show(corrected))
    refused(session.ask("COMMIT"), "FAILED_PRECONDITION.STATE", state="TRIAL")
    quality = session.do("JUDGE").fields["quality"]
    lowest = [quality[which]["metric"]["min"] for which in ("standard", "corrected")]
    require(lowest == [0.25, 0.5], "the quality before and after the correction", str(lowest))
    session.do("COMMIT")
    require(session.do("FETCH").fields["region"], "a region in FETCHED of corrected coordinates", "none")


@suite("23.7")
def larger_region(stage: Stage) -> None:
    """If nodes of a region have cells that were not sent, the server asks for a larger region."""
    session = _correcting(stage)
    region = session.do(session.judge(0.25)).fields["region"]
    correct = session.correct(region["below"], interior=0)
    nodes = correct.arrays["nodes"].copy()
    inner = [node for node in range(len(SQUARE.points)) if node not in OUTER]
    nodes[inner, 1] = 0
    arrays = correct.arrays | {"nodes": nodes, "positions": _squeezed(SQUARE.points, inner[0])}
    corrected = session.do(replace(correct, arrays=arrays))
    larger = corrected.fields["region"].get("rings", 0) > region["rings"]
    require(larger, f"a region of more than {region['rings']} rings", show(corrected))


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
def commit_before_a_judge_of_the_correction(stage: Stage) -> None:
    """A trial that is corrected after its JUDGE is judged again before its COMMIT."""
    session = _correcting(stage)
    session.do(session.judge(0.9), reached=True)
    inner = next(node for node in range(len(SQUARE.points)) if node not in OUTER)
    correct = session.correct()
    session.do(replace(correct, arrays=correct.arrays | {"positions": _squeezed(SQUARE.points, inner)}), region={})
    refused(session.ask("COMMIT"), "FAILED_PRECONDITION.STATE", state="TRIAL")
    session.do("JUDGE")
    session.do("COMMIT")


@suite("23.8")
def bad_quality_is_refused(stage: Stage) -> None:
    """A trial of inverted cells is refused by its JUDGE, and cannot be committed."""
    session = stage.judging()
    reply = refused(session.ask(session.judge(-0.5)), "FAILED_PRECONDITION.QUALITY", state="TRIAL", best=-0.5)
    details = reply.fields["details"]
    right = details.get("fraction", 0) is None and details.get("worst")
    require(right, "a fraction of nil, and the worst cells", show(reply))
    refused(session.ask("COMMIT"), "FAILED_PRECONDITION.STATE", state="TRIAL")


@suite("23.9")
def field_survives(stage: Stage) -> None:
    """After RESUME FETCH gives the committed field and nodes bit for bit; the digest is over both."""
    session = stage.judging()
    session.do("JUDGE")
    committed = session.do("COMMIT")
    before = session.do("FETCH")
    points, rows = before.arrays["points"], before.arrays["coefficients"]
    wanted = digest(session.step, np.concatenate([points, rows]))
    require(committed.fields["digest"] == wanted, "the digest of section 16", committed.fields["digest"].hex())
    session.take_up()
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
