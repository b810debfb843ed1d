"""Restricted wall function: the standard displacement times a function of the wall distance that ends at a distance D.

``u(x) = ψ(d(x)/D) S(x)`` with ``ψ(η) = 1 − 3η² + 2η³``: one with zero slope at the wall, so that the cells next to it
move as they would without the restriction, and zero with zero slope at D. Only nodes with d < D are evaluated.

d is the distance to the nearest control point that moves (sliding nodes that follow the body included). D is chosen
from the motion: the restriction adds up to 1.5 |u|/D to the gradient of the displacement, 0.25 with D = 6 |u|; and D is
no less than 1.5 body sizes, so that many small relative steps do not degrade a thin layer.

References
----------
L. Xie, H. Liu, "Efficient mesh motion using radial basis functions with volume grid points reduction algorithm", J.
Comput. Phys. 348 (2017) 401–415; thesis §2.2.1. Their subspace levels are a point reduction here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from docs.studies.thesis._volume_reduction.problem import (
    Field,
    VolumeDisplacement,
    VolumeField,
    VolumeProblem,
)

__all__ = ["WallFunctionField", "reduce", "restriction"]

Floats = NDArray[np.float64]

_DISPLACEMENTS, _BODIES = 6.0, 1.5
#: Share of the largest displacement below which a sliding node rests.
_ROUNDING = 1e-12


def restriction(eta: Floats) -> Floats:
    """ψ(η), elementwise; 0 for η ≥ 1."""
    t = np.minimum(eta, 1.0)
    return np.asarray(1.0 - t * t * (3.0 - 2.0 * t))


@dataclass(frozen=True, eq=False)
class WallFunctionField:
    """The restricted field.

    Attributes
    ----------
    wall : (w, d) array, mesh length unit
        Control points that move.
    distance : float, mesh length unit
        D.
    """

    wall: Floats
    distance: float
    standard: Field
    control_points: int

    def __call__(self, points: Floats) -> VolumeDisplacement:
        """Displacement of points (n, d); exactly zero at and beyond D."""
        eta = cKDTree(self.wall).query(points, distance_upper_bound=self.distance)[0] / self.distance
        inside = eta < 1.0
        out = np.zeros_like(points)
        out[inside] = restriction(eta[inside])[:, None] * self.standard(points[inside])
        return VolumeDisplacement(out, inside, int(np.count_nonzero(inside)), self.control_points)


def reduce(problem: VolumeProblem) -> VolumeField:
    """Restrict the standard field to the neighbourhood of the moving wall."""
    moves = problem.moving | (np.abs(problem.displacement).max(axis=1) > _ROUNDING * problem.largest)
    distance = problem.reach(_DISPLACEMENTS, _BODIES)
    return WallFunctionField(problem.boundary[moves], distance, problem.standard, len(problem.boundary))
