"""Quality of the positions that a system wrote, by the server's own metric and by OpenFOAM's; the same for all systems.

Size is relative to the reference mesh, size-skew is √size · skew with the sign of size. A cell counts as inverted if
any of its corner determinants is not positive. The boundary error is the largest distance of a boundary node from its
given position.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass

import numpy as np
from mesh_motion_numerics.correction.distortion import PNorm, corner_distortions, corner_simplices
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.finite_volume import FaceMeasures, face_measures
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from numpy.typing import NDArray

from benchmarks.peers.task import Task

__all__ = ["Judge", "Verdict"]

_SHAPE = PNorm(1.0, 1.0, size_weight=0.0)  # −log of the shape

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Verdict:
    """Quality after a motion.

    Attributes
    ----------
    min_size_skew, mean_size_skew : float
        At the end.
    min_size, min_skew : float
        At the end.
    min_shape : float
        Smallest d det(T)^(2/d) / |T|² of T = A Aᵣ⁻¹, from the edges at a corner at rest to those at the end; 0 where a
        cell is inverted.
    near_wall : float
        Minimum size-skew of the cells that touch the body, at the end.
    inverted : int
        Inverted cells at the end.
    most_inverted : int
        Inverted cells in the worst step.
    boundary_error : float
        Largest distance, in any step, of a boundary node from its given place; mesh length unit.
    non_orthogonality, rest_non_orthogonality : float
        Largest of the faces, at the end and at rest, degrees.
    faces_above_65, faces_above_75 : int
        Faces that are less orthogonal, at the end.
    """

    min_size_skew: float
    mean_size_skew: float
    min_size: float
    min_skew: float
    min_shape: float
    near_wall: float
    inverted: int
    most_inverted: int
    boundary_error: float
    non_orthogonality: float
    rest_non_orthogonality: float
    faces_above_65: int
    faces_above_75: int

    def as_dict(self) -> dict[str, float]:
        """As plain values."""
        return asdict(self)


class Judge:
    """Computes the quality of the positions after each step of one task."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self.cells = CellTable.from_arrays(task.cells)
        self.reference = reference_sizes(task.points, self.cells)
        self._corners = corner_simplices(task.points, self.cells, self.reference, at_rest=True)
        self._rest = self._faces(task.points)
        moving = np.isin(np.arange(len(task.points)), task.moving)
        self._touching = np.concatenate([moving[block.nodes].any(axis=1) for block in self.cells])

    def verdict(self, steps: Iterable[Floats]) -> Verdict:
        """Compute the quality of the positions (n, d) after every step of the task, in order.

        Raises
        ------
        ValueError
            If there are more or fewer than the task's steps, or positions of another shape.
        """
        inverted, errors, quality = [], [], None
        for step, positions in enumerate(steps):
            if positions.shape != self.task.points.shape:
                raise ValueError(f"step {step + 1}: expected positions {self.task.points.shape}, got {positions.shape}")
            quality = cell_quality(positions, self.cells, self.reference)
            inverted.append(int(quality.inverted.sum()))
            errors.append(self._boundary_error(positions, step))
        if quality is None or len(inverted) != self.task.steps:
            raise ValueError(f"expected the positions after {self.task.steps} steps, got {len(inverted)}")
        size_skew, faces = quality.metric("size-skew"), self._faces(positions)
        return Verdict(
            min_size_skew=float(size_skew.min()),
            mean_size_skew=float(size_skew.mean()),
            min_size=float(quality.size.min()),
            min_skew=float(quality.skew.min()),
            min_shape=float(np.exp(-corner_distortions(positions, self._corners, _SHAPE).max())),
            near_wall=float(size_skew[self._touching].min()),
            inverted=inverted[-1],
            most_inverted=max(inverted),
            boundary_error=max(errors),
            non_orthogonality=faces.max_non_orthogonality,
            rest_non_orthogonality=self._rest.max_non_orthogonality,
            faces_above_65=faces.faces_above_65,
            faces_above_75=faces.faces_above_75,
        )

    def _faces(self, positions: Floats) -> FaceMeasures:
        """Face measures of a finite-volume code at positions (n, d); all tasks are in 2D or 3D."""
        found = face_measures(positions, self.cells)
        assert found is not None
        return found

    def _boundary_error(self, positions: Floats, step: int) -> float:
        moving = positions[self.task.moving] - self.task.targets(step)
        fixed = positions[self.task.fixed] - self.task.points[self.task.fixed]
        return float(np.linalg.norm(np.concatenate([moving, fixed]), axis=1).max())
