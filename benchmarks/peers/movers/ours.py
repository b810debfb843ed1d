"""The mesh-motion server's own numerics in this process: the cost of a Move without communication.

Every step is committed, so a relative displacement starts from the last one. Compiled kernels are loaded before the
clock starts, as in a server that has been started.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from numpy.typing import NDArray

from benchmarks.one_scale import in_one_scale
from benchmarks.peers.movers.small_task import small_task
from benchmarks.peers.task import Task

__all__ = ["MotionModelMover"]

Floats = NDArray[np.float64]


class MotionModelMover:
    """A model and its committed positions; the options are fields of :class:`Method`, or the solver of one scale."""

    def __init__(self, task: Task, *, solver: str = "", **options: Any) -> None:
        patches = {"moving": Patch("moving", task.moving), "fixed": Patch("fixed", task.fixed)}
        self.task = task
        self.model = MotionModel.build(task.points, CellTable.from_arrays(task.cells), patches, Method(**options))
        if solver:
            self.model = in_one_scale(self.model, solver)
        self.committed = task.points

    def move(self, step: int) -> Floats:
        """Positions after a step, committed."""
        self.committed = self.model.move(self.committed, self.task.targets(step)).points
        return self.committed

    @classmethod
    def prepare(cls, task: Task, options: Mapping[str, Any]) -> None:
        """Load every kernel: move a small mesh of the same cells so far that all kernels are needed."""
        cls(small_task(task), **{**options, "quality_threshold": 0.99}).move(0)
