"""scipy's ``RBFInterpolator`` with its manual's setting for many points: an interpolant of the nearest neighbours.

With all boundary nodes as neighbours it would solve one dense system as the textbook does. With ``neighbors`` it solves
a small system for every node, and can keep only the search tree from step to step. The manual's thin plate
spline has a linear polynomial. The neighbours of most nodes lie on one flat side and do not determine it. So the kernel
here is linear, with a constant.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator

from benchmarks.peers.task import Task

__all__ = ["ScipyRBF"]


class ScipyRBF:
    """scipy's interpolation of each step's displacement from the reference mesh."""

    def __init__(self, task: Task, *, neighbors: int = 50, kernel: str = "linear") -> None:
        self.task = task
        self.neighbors, self.kernel = neighbors, kernel
        self.centres = np.concatenate([task.moving, task.fixed])

    def move(self, step: int) -> NDArray[np.float64]:
        """Positions after a step."""
        task = self.task
        displacement = np.zeros((len(self.centres), task.points.shape[1]))
        displacement[: len(task.moving)] = task.displacements[step]
        found = RBFInterpolator(task.points[self.centres], displacement, neighbors=self.neighbors, kernel=self.kernel)
        moved: NDArray[np.float64] = task.points + found(task.points)
        moved[task.moving] = task.targets(step)
        moved[task.fixed] = task.points[task.fixed]
        return moved
