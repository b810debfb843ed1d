"""Radial basis functions as in textbooks: every boundary node is a centre, with dense matrices and LAPACK's LU.

Wendland's C2 function φ(ξ) = (1 - ξ)⁴ (4ξ + 1), no polynomial, after A. de Boer, M.S. van der Schoot, H. Bijl (2007).
``displacement = "relative"`` interpolates each step's increment from the current positions, and factorizes again.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.task import Task

__all__ = ["DenseRBF", "wendland_matrix"]

Floats = NDArray[np.float64]

#: Rows of the evaluation matrix held at a time: 2048 × 6000 centres are 100 MB.
_CHUNK = 2048


class DenseRBF:
    """The plain method, in numpy.

    Parameters
    ----------
    support_radius : float
        R, mesh length unit.
    displacement : {"relative", "absolute"}
    """

    def __init__(self, task: Task, *, support_radius: float = 2.5, displacement: str = "relative") -> None:
        self.task = task
        self.radius = support_radius
        self.relative = displacement == "relative"
        self.centres = np.concatenate([task.moving, task.fixed])
        self.positions = task.points.copy()
        self.matrix = self._matrix(task.points[self.centres], task.points[self.centres])

    def move(self, step: int) -> Floats:
        """Positions after a step."""
        base = self.positions if self.relative else self.task.points
        if self.relative and step:
            self.matrix = self._matrix(base[self.centres], base[self.centres])
        displacement = np.zeros((len(self.centres), base.shape[1]))
        moving = len(self.task.moving)
        displacement[:moving] = self.task.targets(step) - base[self.task.moving]
        weights = np.linalg.solve(self.matrix, displacement)
        moved = base.copy()
        for first in range(0, len(base), _CHUNK):
            rows = slice(first, first + _CHUNK)
            moved[rows] += self._matrix(base[rows], base[self.centres]) @ weights
        moved[self.task.moving] = self.task.targets(step)
        moved[self.task.fixed] = self.task.points[self.task.fixed]
        self.positions = moved
        return moved

    def _matrix(self, points: Floats, centres: Floats) -> Floats:
        """(p, c) values of φ."""
        return wendland_matrix(points, centres, self.radius)


def wendland_matrix(points: Floats, centres: Floats, radius: float) -> Floats:
    """(p, c) values of φ for points (p, d) and centres (c, d)."""
    square = np.zeros((len(points), len(centres)))
    for x, c in zip(points.T, centres.T, strict=True):
        square += (x[:, None] - c) ** 2
    r = np.sqrt(square) / radius
    values: Floats = np.where(r < 1, (1 - r) ** 4 * (4 * r + 1), 0.0)
    return values
