"""Section 13: what an upload is, and which meshes are refused."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from mesh_motion_conformance.case import Case, Suite, Unmet
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.server.mesh import SQUARE, Part, Side
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.session import Session
from mesh_motion_conformance.server.stage import Stage
from mesh_motion_conformance.show import show
from mesh_motion_conformance.wire import Message

__all__ = ["suite"]

suite = Suite()


def _upload(session: Session, rows: Any, **fields: str) -> Message:
    return session.ask(Request("UPLOAD", session.address() | fields, {"rows": np.asarray(rows)}))


@suite.family
def parts() -> Iterator[Case]:
    """13.2, each row of the table broken in one place"""

    def run(codes: tuple[str, ...], rows: Any, fields: dict[str, str]) -> Callable[[Stage], None]:
        def broken(stage: Stage) -> None:
            refused(_upload(stage.session("OPENING"), rows, **fields), *codes, state="OPENING")

        return broken

    shape, dtype, value = (f"INVALID_ARGUMENT.{name}" for name in ("SHAPE", "DTYPE", "VALUE"))
    nodes, three, one = np.zeros((2, 2)), np.zeros((2, 3), "<i8"), np.zeros((2, 1), "<i8")
    item = {"item": "nodes"}
    cells, patch = {"item": "cells", "name": "triangle"}, {"item": "patch", "name": "more", "role": "fixed"}
    ids = {"item": "global_ids"}
    ways: dict[str, tuple[str, Any, dict[str, str]]] = {
        "nodes-of-1-column": (shape, nodes[:, :1], item),
        "nodes-of-3-columns": (shape, np.zeros((2, 3)), item),
        "nodes-as-integers": (dtype, nodes.astype("<i8"), item),
        "nodes-as-narrow-integers": (dtype, nodes.astype("<i4"), item),
        "nodes-with-a-name": (value, nodes, item | {"name": "wing"}),
        "nodes-with-a-role": (value, nodes, item | {"role": "moving"}),
        "cells-as-floats": (dtype, three.astype("<f8"), cells),
        "cells-as-narrow-floats": (dtype, three.astype("<f4"), cells),
        "cells-of-2-columns": (shape, three[:, :2], cells),
        "cells-of-4-columns": (shape, np.zeros((2, 4), "<i8"), cells),
        "cells-of-no-type": (value, three, cells | {"name": ""}),
        "cells-of-an-unknown-type": (value, three, cells | {"name": "polygon"}),
        "cells-of-a-type-in-capitals": (value, three, cells | {"name": "Triangle"}),
        "cells-of-3D": (value, np.zeros((2, 4), "<i8"), cells | {"name": "tetra"}),
        "cells-of-1D": (value, np.zeros((2, 2), "<i8"), cells | {"name": "line"}),
        "cells-with-a-role": (value, three, cells | {"role": "fixed"}),
        "patch-as-floats": (dtype, one.astype("<f8"), patch),
        "patch-of-2-columns": (shape, np.zeros((2, 2), "<i8"), patch),
        "patch-of-no-column": (shape, np.zeros((2, 0), "<i8"), patch),
        "patch-without-a-name": (value, one, patch | {"name": ""}),
        "patch-without-a-role": (value, one, patch | {"role": ""}),
        "patch-of-two-roles": (value, one, patch | {"name": "left", "role": "fixed"}),
        "global-ids-as-floats": (dtype, one.astype("<f8"), ids),
        "global-ids-of-2-columns": (shape, np.zeros((2, 2), "<i8"), ids),
        "global-ids-with-a-name": (value, one, ids | {"name": "wing"}),
        "facets-where-the-server-has-the-cells": (value, three[:, :2], {"item": "facets", "name": "line"}),
    }
    for name, (code, rows, fields) in ways.items():
        yield Case("13.2", name, "rows, name and role are those of the item's row", run((code,), rows, fields))


@suite("13.2")
def parts_are_appended(stage: Stage) -> None:
    """Parts of the same item and name are appended; rows_total counts them."""
    session = stage.session("OPENING", "appended")
    fields = {"item": "patch", "name": "counted", "role": "fixed"}
    totals = [
        answered(_upload(session, np.full((rows, 1), 3, "<i8"), **fields), "UPLOADED").fields["rows_total"]
        for rows in (2, 0, 3)
    ]
    others = answered(_upload(session, np.full((1, 1), 3, "<i8"), **(fields | {"name": "other"})), "UPLOADED")
    if totals != [2, 2, 5] or others.fields["rows_total"] != 1:
        raise Unmet("rows_total 2, 2, 5, and 1 of another patch", f"{totals}, {show(others)}")
    session.do("BUILD")


@suite("13.2")
def what_a_mesh_needs(stage: Stage) -> None:
    """A mesh needs nodes, cells and a moving patch; a BUILD that is refused has no effect, and more may be uploaded."""
    session = stage.open()
    mesh = "INVALID_ARGUMENT"
    moving = np.array([[0], [4], [8], [12]], dtype="<i8")
    try:
        answered(_upload(session, SQUARE.triangles, item="cells", name="triangle"), "UPLOADED")
        refused(session.ask("BUILD"), mesh, state="OPENING")
        answered(_upload(session, SQUARE.points, item="nodes"), "UPLOADED")
        refused(session.ask("BUILD"), mesh, state="OPENING")
        answered(_upload(session, moving + 3, item="patch", name="right", role="fixed"), "UPLOADED")
        refused(session.ask("BUILD"), mesh, state="OPENING")
        answered(_upload(session, moving, item="patch", name="left", role="moving"), "UPLOADED")
        session.do("BUILD")
    finally:
        session.discard()


@suite.family
def bad_meshes() -> Iterator[Case]:
    """13.1, 13.3"""

    def run(part: Part, *codes: str) -> Callable[[Stage], None]:
        def bad(stage: Stage) -> None:
            session = stage.open(part)
            try:
                session.upload()
                reply = refused(session.ask("BUILD"), *codes, state="OPENING")
            finally:
                session.discard()
            if not reply.fields["details"]:
                raise Unmet("details that name the first offender", show(reply))

        return bad

    folded = SQUARE.points.copy()
    folded[5, 0] = -0.05
    yield Case(
        "13.3",
        "inverted-cell",
        "a mesh with a cell that lies over another one is refused",
        run(Part(folded, SQUARE.triangles, SQUARE.sides), "INVALID_ARGUMENT.MESH_DEGENERATE"),
    )
    beyond = SQUARE.triangles.copy()
    beyond[5, 1] = 16
    yield Case(
        "13.1",
        "cell-of-a-node-that-is-not-there",
        "cells refer to local indices, counted from 0",
        run(Part(SQUARE.points, beyond, SQUARE.sides), "INVALID_ARGUMENT"),
    )
    sides = SQUARE.sides | {"far": Side("fixed", (-1,))}
    yield Case(
        "13.1",
        "patch-of-a-negative-node",
        "patches refer to local indices, counted from 0",
        run(Part(SQUARE.points, SQUARE.triangles, sides), "INVALID_ARGUMENT"),
    )


@suite.family
def usable_meshes() -> Iterator[Case]:
    """13.3"""

    def run(part: Part) -> Callable[[Stage], None]:
        def usable(stage: Stage) -> None:
            session = stage.open(part)
            try:
                session.upload()
                session.do("BUILD")
            finally:
                session.discard()

        return usable

    triangles = SQUARE.triangles.copy()
    triangles[5] = triangles[5][[0, 2, 1]]
    yield Case(
        "13.3",
        "mirrored-cell",
        "A cell that is listed the other way round is read as its mirror image",
        run(Part(SQUARE.points, triangles, SQUARE.sides)),
    )
    sides = SQUARE.sides | {"left": Side("moving", (0, 4, 8, 12, 16))}
    yield Case(
        "13.3",
        "nodes-at-one-place",
        "Boundary nodes at the same place are interpolated as one node",
        run(Part(np.vstack([SQUARE.points, SQUARE.points[0]]), SQUARE.triangles, sides)),
    )


@suite("13.5")
def moving_nodes_ascend(stage: Stage) -> None:
    """moving_nodes are ascending for any order of the patches; a node on a moving patch moves."""
    sides = {"b": Side("fixed", (3, 7, 11, 15, 12)), "a": Side("moving", (12, 8)), "c": Side("moving", (0, 4, 8))}
    part = Part(SQUARE.points, SQUARE.triangles, sides)
    session = stage.open(part)
    try:
        session.upload()
        found = session.do("BUILD").arrays["moving_nodes"].tolist()
        joined = session.join()[0].arrays["moving_nodes"].tolist()
        if (found, joined) != ([0, 4, 8, 12], [0, 4, 8, 12]):
            raise Unmet("moving_nodes [0, 4, 8, 12] in BUILT and in JOINED", f"{found}, {joined}")
    finally:
        session.discard()


@suite("13.5")
def JOINED_names_the_moving_patches(stage: Stage) -> None:
    """JOINED names each moving patch, with its nodes in the order of UPLOAD, after RESUME too."""
    sides = {"b": Side("fixed", (3, 7, 11, 15)), "c": Side("moving", (12, 8)), "a": Side("moving", (0, 8, 4))}
    session = stage.open(Part(SQUARE.points, SQUARE.triangles, sides))
    try:
        session.upload()
        session.do("BUILD")
        session.resume()
        joined = session.join()[0]
        counts = joined.fields.get("moving_patches", [])
        nodes = joined.arrays.get("patch_nodes", np.empty(0)).tolist()
        found = {}
        for name, count in counts:
            found[name], nodes = nodes[:count], nodes[count:]
        if found != {"c": [12, 8], "a": [0, 8, 4]} or nodes:
            raise Unmet("patch c with the nodes 12, 8 and patch a with 0, 8, 4", show(joined))
        if joined.fields.get("extent") != np.ptp(SQUARE.points, axis=0).max():
            raise Unmet("the longest side of the mesh's bounding box", show(joined))
    finally:
        session.discard()
