"""scipy's ``RBFInterpolator`` as its manual offers it for many points: an interpolant of the nearest neighbours.

With all boundary nodes as neighbours it would solve one dense system as the textbook does; with ``neighbors`` it solves
a small one for every node, of which nothing can be kept from step to step but the search tree. The manual's thin plate
spline has a linear polynomial, which the neighbours of most nodes do not determine: they lie on one flat side. So the
kernel is the linear one, with a constant.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator

from benchmarks.peers.task import Task

__all__ = ["ScipyRBF"]


class ScipyRBF:
    """scipy's interpolation of each step's displacement from the reference mesh.

    Parameters
    ----------
    task : Task
    neighbors : int
    kernel : str
    """

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
