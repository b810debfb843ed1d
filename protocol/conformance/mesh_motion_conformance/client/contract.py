"""Data that every driver program knows: the mesh, the displacements, the verbs (README.md describes them)."""

from __future__ import annotations

import numpy as np

from mesh_motion_conformance.wire import Array

__all__ = ["LEFT", "POINTS", "RIGHT", "TRIANGLES", "VERBS", "displacement_of"]

#: A unit square of two triangles; the left side moves, the right one is fixed.
POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]], dtype="<i8")
LEFT, RIGHT = np.array([0, 3], dtype="<i8"), np.array([1, 2], dtype="<i8")

VERBS = ("hello", "open", "move", "move-reference", "tangent", "cotangent", "commit", "rollback", "status", "points",
         "resume", "close", "discard", "again")  # fmt: skip


def displacement_of(rows: Array) -> Array:
    """(4, 2) answer of the scripted server to the displacement of nodes 0 and 3; the other two stay."""
    whole = np.zeros((4, 2))
    whole[LEFT] = rows
    return whole
