"""Section 13: what an upload is, and which meshes are refused."""

from __future__ import annotations

from typing import Any

import numpy as np

from mesh_motion_conformance.case import require
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.server.mesh import SQUARE, Part, Side
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.show import show

_SHAPE, _DTYPE, _VALUE = (f"INVALID_ARGUMENT.{name}" for name in ("SHAPE", "DTYPE", "VALUE"))
_ROWS, _THREE, _ONE = np.zeros((2, 2)), np.zeros((2, 3), "<i8"), np.zeros((2, 1), "<i8")
_ITEM, _IDS = {"item": "nodes"}, {"item": "global_ids"}
_CELLS, _PATCH = {"item": "cells", "name": "triangle"}, {"item": "patch", "name": "more", "role": "fixed"}
_BROKEN: dict[str, tuple[str, Any, dict[str, str]]] = {
    "nodes-of-1-column": (_SHAPE, _ROWS[:, :1], _ITEM),
    "nodes-of-3-columns": (_SHAPE, np.zeros((2, 3)), _ITEM),
    "nodes-as-integers": (_DTYPE, _ROWS.astype("<i8"), _ITEM),
    "nodes-as-narrow-integers": (_DTYPE, _ROWS.astype("<i4"), _ITEM),
    "nodes-with-a-name": (_VALUE, _ROWS, _ITEM | {"name": "wing"}),
    "nodes-with-a-role": (_VALUE, _ROWS, _ITEM | {"role": "moving"}),
    "cells-as-floats": (_DTYPE, _THREE.astype("<f8"), _CELLS),
    "cells-as-narrow-floats": (_DTYPE, _THREE.astype("<f4"), _CELLS),
    "cells-of-2-columns": (_SHAPE, _THREE[:, :2], _CELLS),
    "cells-of-4-columns": (_SHAPE, np.zeros((2, 4), "<i8"), _CELLS),
    "cells-of-no-type": (_VALUE, _THREE, _CELLS | {"name": ""}),
    "cells-of-an-unknown-type": (_VALUE, _THREE, _CELLS | {"name": "polygon"}),
    "cells-of-a-type-in-capitals": (_VALUE, _THREE, _CELLS | {"name": "Triangle"}),
    "cells-of-3D": (_VALUE, np.zeros((2, 4), "<i8"), _CELLS | {"name": "tetra"}),
    "cells-of-1D": (_VALUE, np.zeros((2, 2), "<i8"), _CELLS | {"name": "line"}),
    "cells-with-a-role": (_VALUE, _THREE, _CELLS | {"role": "fixed"}),
    "patch-as-floats": (_DTYPE, _ONE.astype("<f8"), _PATCH),
    "patch-of-2-columns": (_SHAPE, np.zeros((2, 2), "<i8"), _PATCH),
    "patch-of-no-column": (_SHAPE, np.zeros((2, 0), "<i8"), _PATCH),
    "patch-without-a-name": (_VALUE, _ONE, _PATCH | {"name": ""}),
    "patch-without-a-role": (_VALUE, _ONE, _PATCH | {"role": ""}),
    "patch-of-two-roles": (_VALUE, _ONE, _PATCH | {"name": "left", "role": "fixed"}),
    "global-ids-as-floats": (_DTYPE, _ONE.astype("<f8"), _IDS),
    "global-ids-of-2-columns": (_SHAPE, np.zeros((2, 2), "<i8"), _IDS),
    "global-ids-with-a-name": (_VALUE, _ONE, _IDS | {"name": "wing"}),
    "facets-where-the-server-has-the-cells": (_VALUE, _THREE[:, :2], {"item": "facets", "name": "line"}),
}


@suite("13.2", _BROKEN)
def parts(stage: Stage, code: str, rows: Any, fields: dict[str, str]) -> None:
    """rows, name and role are those of the item's row."""
    session = stage.session("OPENING")
    refused(session.ask(session.uploading(rows, **fields)), code, state="OPENING")


@suite("13.2")
def parts_are_appended(stage: Stage) -> None:
    """Parts of the same item and name are appended; rows_total counts them."""
    session = stage.session("OPENING", "appended")
    fields = {"item": "patch", "name": "counted", "role": "fixed"}
    for rows, total in ((2, 2), (0, 2), (3, 5)):
        session.do(session.uploading(np.full((rows, 1), 3, "<i8"), **fields), rows_total=total)
    session.do(session.uploading(np.full((1, 1), 3, "<i8"), **fields | {"name": "other"}), rows_total=1)
    session.do("BUILD")


@suite("13.2")
def what_a_mesh_needs(stage: Stage) -> None:
    """A mesh needs nodes, cells and a moving patch; a BUILD that is refused has no effect, and more may be uploaded."""
    session = stage.open()
    nodes, cells, left, right = SQUARE.uploads()
    for fields, rows in (cells, nodes, right):
        session.do(session.uploading(rows, **fields))
        refused(session.ask("BUILD"), "INVALID_ARGUMENT", state="OPENING")
    session.do(session.uploading(left[1], **left[0]))
    session.do("BUILD")


def _bad(stage: Stage, part: Part, code: str) -> None:
    """A mesh of this part is refused with the code, and details."""
    session = stage.open(part)
    session.upload()
    reply = refused(session.ask("BUILD"), code, state="OPENING")
    require(reply.fields["details"], "details that name the first offender", show(reply))


@suite("13.3")
def inverted_cell(stage: Stage) -> None:
    """A mesh with a cell that lies over another one is refused."""
    folded = SQUARE.points.copy()
    folded[5, 0] = -0.05
    _bad(stage, Part(folded, SQUARE.triangles, SQUARE.sides), "INVALID_ARGUMENT.MESH_DEGENERATE")


@suite("13.1")
def cell_of_a_node_that_is_not_there(stage: Stage) -> None:
    """Cells refer to local indices, counted from 0."""
    beyond = SQUARE.triangles.copy()
    beyond[5, 1] = 16
    _bad(stage, Part(SQUARE.points, beyond, SQUARE.sides), "INVALID_ARGUMENT")


@suite("13.1")
def patch_of_a_negative_node(stage: Stage) -> None:
    """Patches refer to local indices, counted from 0."""
    sides = SQUARE.sides | {"far": Side("fixed", (-1,))}
    _bad(stage, Part(SQUARE.points, SQUARE.triangles, sides), "INVALID_ARGUMENT")


@suite("13.3")
def mirrored_cell(stage: Stage) -> None:
    """A cell that is listed the other way round is read as its mirror image."""
    triangles = SQUARE.triangles.copy()
    triangles[5] = triangles[5][[0, 2, 1]]
    stage.open(Part(SQUARE.points, triangles, SQUARE.sides)).build()


@suite("13.3")
def nodes_at_one_place(stage: Stage) -> None:
    """Boundary nodes at the same place are interpolated as one node."""
    sides = SQUARE.sides | {"left": Side("moving", (0, 4, 8, 12, 16))}
    stage.open(Part(np.vstack([SQUARE.points, SQUARE.points[0]]), SQUARE.triangles, sides)).build()


@suite("13.5")
def moving_nodes_ascend(stage: Stage) -> None:
    """moving_nodes are ascending for any order of the patches; a node on a moving patch moves."""
    sides = {"b": Side("fixed", (3, 7, 11, 15, 12)), "a": Side("moving", (12, 8)), "c": Side("moving", (0, 4, 8))}
    session = stage.open(Part(SQUARE.points, SQUARE.triangles, sides))
    for reply in (session.build(), *session.join()):
        moving = reply.arrays["moving_nodes"].tolist()
        require(moving == [0, 4, 8, 12], "moving_nodes [0, 4, 8, 12] in BUILT and in JOINED", show(reply))


@suite("13.5")
def JOINED_names_the_moving_patches(stage: Stage) -> None:
    """JOINED names each moving patch, with its nodes in the order of UPLOAD, after RESUME too."""
    sides = {"b": Side("fixed", (3, 7, 11, 15)), "c": Side("moving", (12, 8)), "a": Side("moving", (0, 8, 4))}
    session = stage.open(Part(SQUARE.points, SQUARE.triangles, sides))
    session.build()
    extent = np.ptp(SQUARE.points, axis=0).max()  # the longest side of the mesh's bounding box
    joined = answered(session.take_up()[0], "JOINED", extent=extent)
    counts = joined.fields.get("moving_patches", [])
    nodes = joined.arrays.get("patch_nodes", np.empty(0)).tolist()
    found = {}
    for name, count in counts:
        found[name], nodes = nodes[:count], nodes[count:]
    right = found == {"c": [12, 8], "a": [0, 8, 4]} and not nodes
    require(right, "patch c with the nodes 12, 8 and patch a with 0, 8, 4", show(joined))
