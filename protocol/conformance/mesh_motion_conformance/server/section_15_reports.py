"""Sections 15 and 16: contents of the maps in replies, and the digest computed again."""

from __future__ import annotations

import hashlib
import math
import struct
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from mesh_motion_conformance.case import Unmet, require
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.tables import tables
from mesh_motion_conformance.wire import Array

__all__ = ["digest"]

_NUMBER = (int, float)
_STATISTICS = dict.fromkeys(("min", "mean", "p1", "p5", "p50"), _NUMBER)
_SUMMARY: dict[str, Any] = dict.fromkeys(("size", "skew", "size_skew", "metric"), _STATISTICS) | {
    "inverted": int, "cells": int, "worst": list,
}  # fmt: skip
_WORST: dict[str, Any] = {
    "partition": int, "type": str, "cell": int, "centre": list, "size": _NUMBER, "skew": _NUMBER,
    "size_skew": _NUMBER, "metric": _NUMBER,
}  # fmt: skip


def _check(value: Any, wanted: Any, where: str) -> None:
    """Check that a map has at least these keys, of these types."""
    if isinstance(wanted, dict):
        require(isinstance(value, dict), f"{where}: a map", f"{value!r:.80}")
        for key, kind in wanted.items():
            require(key in value, f"{where}.{key}", f"the keys {sorted(value)}")
            _check(value[key], kind, f"{where}.{key}")
    elif (isinstance(value, bool) and wanted is not bool) or not isinstance(value, wanted):
        raise Unmet(f"{where}: {wanted}", f"{value!r:.80}")


def _summary(value: Any, where: str) -> None:
    """A summary with its worst cells."""
    _check(value, _SUMMARY, where)
    require(0 < len(value["worst"]) <= 10, f"{where}.worst: at most 10 cells", str(len(value["worst"])))
    for cell in value["worst"]:
        _check(cell, _WORST, f"{where}.worst")
    metrics = [cell["metric"] for cell in value["worst"]]
    require(metrics == sorted(metrics), f"{where}.worst: worst first", str(metrics))
    counts = value["cells"], value["inverted"]
    require(counts == (18, 0), f"{where}: 18 cells, none inverted", str(counts))
    for name in ("size", "skew", "size_skew", "metric"):
        require(value[name]["min"] <= value[name]["p50"], f"{where}.{name}: min ≤ p50", str(value[name]))


_FACES: dict[str, Any] = {
    "faces": int, "max_non_orthogonality": _NUMBER, "faces_above_65": int, "faces_above_75": int,
    "max_skewness": _NUMBER, "min_volume_ratio": _NUMBER, "shortest_edge": _NUMBER, "smallest_face": _NUMBER,
    "worst": list,
}  # fmt: skip
_CELL: dict[str, Any] = {"partition": int, "type": str, "cell": int}


@suite("15")
def MOVED_faces_asked(stage: Stage) -> None:
    """Fields of type map in replies have at least these keys"""  # 18 right-angled triangles; 21 edges between two
    session = stage.session("READY")
    request = session.request("MOVE").having(report="faces")
    found = session.do(request).fields["faces"]
    for name in ("before", "after"):
        given = found.get(name)
        _check(given, _FACES, f"faces.{name}")
        counts = given["faces"], len(given["worst"])
        require(counts[0] == 21 and 0 < counts[1] <= 10, f"faces.{name}: 21 faces, at most 10 worst", str(counts))
        for face in given["worst"]:
            _check(face, _CELL | {"neighbour": _CELL, "centre": list, "non_orthogonality": _NUMBER}, "faces.worst")
        angles = [face["non_orthogonality"] for face in given["worst"]]
        ordered = angles == sorted(angles, reverse=True) and angles[0] == given["max_non_orthogonality"]
        require(ordered, "faces.worst: the least orthogonal first", str(angles))
    least = [found["before"][name] for name in ("shortest_edge", "smallest_face")]
    require(least == [1.0, 1.0], "faces.before: edges and faces as long and large as at rest", str(least))
    angle = found["before"]["max_non_orthogonality"]
    wanted = math.degrees(math.atan(0.5))  # d leads two thirds of a square across and one third up
    require(abs(angle - wanted) <= 1e-6, "faces.before: the reference mesh's 26.565 degrees", str(angle))


@suite("15")
def MOVED_headroom_asked(stage: Stage) -> None:
    """Fields of type map in replies have at least these keys"""
    # first a step without motion, which nothing limits; then a step that can be repeated a few times
    session = stage.session("READY")
    still = session.request("MOVE").having(report="headroom").carrying(displacement=np.zeros((4, 2)))
    found = session.do(still).fields["headroom"]
    require("inversion" not in found and "cell" not in found, "headroom: nothing ends where nothing moves", str(found))
    whole = session.request("MOVE").having(report="headroom")
    ahead = session.do(whole).fields["headroom"]
    _check(ahead, {"inversion": _NUMBER, "threshold": _NUMBER, "cell": dict}, "headroom")
    _check(ahead["cell"], _CELL, "headroom.cell")
    ascending = 0.0 <= ahead["threshold"] <= ahead["inversion"] <= 100.0
    require(ascending, "headroom: 0 ≤ threshold ≤ inversion ≤ 100", str(ahead))
    asked = session.request("MOVE").having(report="headroom")
    on = asked.having(velocity="tangent").carrying(boundary_velocity=session.rows())
    for wanted, request in (("step", asked), ("displacement", asked), ("velocity", on)):
        along = session.do(request.having(headroom_along=wanted)).fields["headroom"]["along"]
        require(along == wanted, f"headroom.along: {wanted}", along)


_MOVED: dict[str, Any] = {
    "correction": {"method": str, "enrichment_points": int, "freed_nodes": int, "iterations": int, "reached": bool,
                   "control_points": int, "support_radius": _NUMBER, "sub_steps": int},
    "caches": {"factorization": str},
    "seconds": dict.fromkeys(("solve", "predict", "correct", "displace", "total"), _NUMBER),
}  # fmt: skip


def _moved_quality(fields: dict[str, Any]) -> None:
    quality = fields["quality"]
    _check(quality, {"metric": str, "threshold": _NUMBER}, "quality")
    for name in ("standard", "corrected"):
        _summary(quality[name], f"quality.{name}")
    metrics = tables().settings["quality_metric"]["choices"]
    require(quality["metric"] in metrics, f"quality.metric: one of {metrics}", repr(quality["metric"]))


def _built_mesh(fields: dict[str, Any]) -> None:
    mesh = fields["mesh"]
    wanted = {"nodes": 16, "cells": {"triangle": 18}, "moving_nodes": 4}
    require({name: mesh.get(name) for name in wanted} == wanted, str(wanted), str(mesh))
    sides = {name: (row["role"], row["nodes"]) for name, row in mesh["patches"].items()}
    wanted = {"left": ("moving", 4), "right": ("fixed", 4)}
    require(sides == wanted, "patches left: moving, 4 nodes; right: fixed, 4 nodes", str(mesh["patches"]))
    box = np.abs(np.array(mesh["box"]) - [[0.0, 0.0], [0.3, 0.3]]).max() <= 1e-15
    require(box, "box [[0, 0], [0.3, 0.3]]", str(mesh["box"]))
    _check(mesh, {"warnings": list}, "mesh")


def _factorization(fields: dict[str, Any]) -> None:
    caches = fields["caches"]
    require(caches["factorization"] in ("reused", "made"), "caches.factorization: reused or made", str(caches))


def _quality(fields: dict[str, Any]) -> None:
    _summary(fields["quality"], "quality")


def _is_empty(name: str, fields: dict[str, Any]) -> None:
    require(not fields.get(name), f"{name}: an empty map", str(fields.get(name))[:80])


_KEYS = "Fields of type map in replies have at least these keys"
_REPORTS: dict[str, tuple[str, str, Callable[[dict[str, Any]], None]]] = {
    "COMMITTED-quality": (_KEYS, "COMMIT", _quality),
    "BUILT-quality": (_KEYS, "BUILD", _quality),
    "MOVED-quality": (_KEYS, "MOVE", _moved_quality),
    **{f"MOVED-{name}": (_KEYS, "MOVE", partial(_check, wanted={name: wanted}, where="MOVED"))
       for name, wanted in _MOVED.items()},
    "MOVED-factorization": ("factorization is reused or made", "MOVE", _factorization),
    "MOVED-faces": ("faces is empty where report is not faces", "MOVE", partial(_is_empty, "faces")),
    "MOVED-headroom": (
        "headroom is empty where report is neither headroom nor faces", "MOVE", partial(_is_empty, "headroom"),
    ),
    "BUILT-mesh": (_KEYS, "BUILD", _built_mesh),
}  # fmt: skip


@suite("15", _REPORTS)
def reports(stage: Stage, _: str, kind: str, look: Callable[[dict[str, Any]], None]) -> None:
    """{0}"""
    if kind == "BUILD":
        session = stage.kept("reported", stage.open)
        look((session.built or session.build()).fields)
    else:
        look(stage.session("TRIAL" if kind == "COMMIT" else "READY").do(kind).fields)


@suite("15")
def LISTED_sessions(stage: Stage) -> None:
    """LISTED's entries have session, label, state, step, partitions, worker."""
    session = stage.session("TRIAL")
    entries = answered(stage.ask(Request("LIST")), "LISTED").fields["sessions"]
    wanted = {"session": str, "label": str, "state": str, "step": int, "partitions": int, "worker": str}
    for entry in entries:
        _check(entry, wanted, "sessions")
    given = {"label": "conformance", "state": "TRIAL", "step": session.step, "partitions": 1, "worker": "alive"}
    given["session"] = session.id
    listed = stage.until(
        lambda: answered(stage.ask(Request("LIST")), "LISTED").fields["sessions"], lambda entries: given in entries
    )
    require(given in listed, str(given), str([entry for entry in listed if entry["session"] == session.id]))


@suite("15")
def details_of_a_refused_quality(stage: Stage) -> None:
    """FAILED_PRECONDITION.QUALITY has best, fraction and worst."""
    session = stage.session("READY")
    request = session.request("MOVE").carrying(displacement=session.rows(size=50.0))
    details = refused(session.ask(request), "FAILED_PRECONDITION.QUALITY", state="READY").fields["details"]
    _check(details, {"best": _NUMBER, "fraction": (int, float, type(None)), "worst": list}, "details")
    for cell in details["worst"]:
        _check(cell, {"partition": int, "type": str, "cell": int}, "details.worst")


# --- 16 --------------------------------------------------------------------------------------------------------------


def digest(step: int, points: Array) -> bytes:
    """SHA-256 over what section 16's table lists."""
    text = b"mesh-motion state 1\n" + struct.pack("<qqq", step, *points.shape) + points.astype("<f8").tobytes()
    return hashlib.sha256(text).digest()


_MOVES = {
    "one-move": ([0.01], False),
    "last-of-three-moves": ([0.01, 0.02, 0.005], False),
    "after-a-rollback": ([-0.01], True),
    "no-motion": ([0.0], False),
}


@suite("16", _MOVES)
def digests(stage: Stage, moves: list[float], drop: bool) -> None:
    """The digest is SHA-256 over the prefix, step, n, d and the committed coordinates."""
    session = stage.session("READY")
    if drop:
        session.do("MOVE")
        session.do("ROLLBACK")
    for size in moves:
        session.do(session.request("MOVE").carrying(displacement=session.rows(size=size)))
    committed = session.do("COMMIT").fields
    wanted = digest(session.step, session.do("FETCH").arrays["points"])
    require(committed["digest"] == wanted, f"digest {wanted.hex()}", committed["digest"].hex())
    require(committed["durable_step"] <= committed["step"], "durable_step ≤ step", str(committed["durable_step"]))


@suite("16")
def same_state_same_digest_after_resume(stage: Stage) -> None:
    """After RESUME the committed coordinates match the digest."""
    session = stage.session("TRIAL")
    committed = session.do("COMMIT").fields["digest"]
    session.take_up()
    wanted = digest(session.step, session.do("FETCH").arrays["points"])
    require(committed == wanted, f"digest {wanted.hex()}", committed.hex())
