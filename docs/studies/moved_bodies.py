"""Meshes of the tests and examples, and motions of their bodies, for studies of whole motions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.motion.motion_found import Motion
from mesh_motion_protocol.errors import QualityRefused
from numpy.typing import NDArray

__all__ = ["StoredMesh", "Turn", "final_quality", "moved", "stored"]

ROOT = Path(__file__).parents[2]
Floats = NDArray[np.float64]

#: Roles by the names that the stored meshes use; anything else is fixed.
_MOVING = ("block", "body", "flag", "wing", "box", "slab", "piston")
_SLIDING = {"symmetry": "symmetry", "liner": "slip"}


@dataclass(frozen=True, eq=False)
class StoredMesh:
    """A mesh with the roles of its patches."""

    points: Floats
    cells: CellTable
    patches: Mapping[str, Patch]

    def model(self, **choices: Any) -> MotionModel:
        """The mesh with a method."""
        return MotionModel.build(
            self.points, self.cells, self.patches, Method(**{"quality_metric": "size-skew", **choices})
        )


@cache
def stored(path: str) -> StoredMesh:
    """A mesh by its path in the repository, without ``.npz``: ``tests/references/thesis_block``."""
    with np.load(ROOT / f"{path}.npz") as data:
        cells = {key.removeprefix("cells_"): data[key] for key in data if key.startswith("cells_")}
        named = {key.removeprefix("patch_"): data[key] for key in data if key.startswith("patch_")}
        patches = {name: Patch(_role(name), nodes.astype(np.int64)) for name, nodes in named.items()}
        return StoredMesh(data["points"], CellTable.from_arrays(cells), patches)


def _role(patch: str) -> str:
    """Nodes of the patch with this name."""
    return "moving" if patch in _MOVING else _SLIDING.get(patch, "fixed")


@dataclass(frozen=True)
class Turn:
    """A translation after a rotation about a centre; in 3D about an axis (default: z)."""

    shift: tuple[float, ...]
    degrees: float = 0.0
    centre: tuple[float, ...] | None = None
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __call__(self, points: Floats) -> Floats:
        """New positions of points (n, d); the centre is the middle of their bounding box unless it is given."""
        middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
        centre = middle if self.centre is None else np.asarray(self.centre)
        return (points - centre) @ self._matrix(points.shape[1]).T + centre + np.asarray(self.shift)

    def _matrix(self, d: int) -> Floats:
        """(d, d) rotation, by Rodrigues' formula."""
        n = np.asarray(self.axis) / np.linalg.norm(self.axis)
        cross = np.array([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]])
        angle = np.deg2rad(self.degrees)
        turn = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
        return np.asarray(turn[:d, :d])


def moved(model: MotionModel, turn: Turn) -> Motion:
    """Move the model's moving nodes by one step from the reference mesh."""
    return model.move(model.points, turn(model.points[model.roles.moving]))


def final_quality(model: MotionModel, turn: Turn) -> float:
    """Minimum of the model's metric after the motion; for a refused motion, that of the best mesh found."""
    try:
        return moved(model, turn).corrected.metric.min
    except QualityRefused as refusal:
        return float("nan") if refusal.best is None else refusal.best
