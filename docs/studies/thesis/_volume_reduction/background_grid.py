"""Background Cartesian grid: the sums are taken at the points of a coarse grid and interpolated to the nodes.

Cubic (Lagrange, four points an axis) by default, linear for comparison: the error falls as h⁴ and h² if the field is
smooth. Close to control points the field is not smooth: it has the kernels' singularities. So nodes within two spacings
of a control point are evaluated directly; over a third spacing direct and interpolated values are blended (a hard
switch would leave a jump that ruins small cells); the relative error is then about the same for any spacing, a few
times 10⁻⁴ of the displacement.

The spacing is chosen so that grid points and direct nodes together are fewest. Grid points that no node needs are
not evaluated.

References
----------
Thesis §2.2.1. R. G. Keys, "Cubic convolution interpolation for digital image processing", IEEE Trans. ASSP 29 (1981)
1153–1160, on local cubic interpolation of gridded data.
"""

from __future__ import annotations

from dataclasses import dataclass

import mesh_motion_kernels as kernels
import numpy as np
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from docs.studies.thesis._volume_reduction.problem import (
    Field,
    VolumeDisplacement,
    VolumeField,
    VolumeProblem,
)
from docs.studies.thesis._volume_reduction.wall_function import restriction

__all__ = ["INTERPOLATIONS", "CartesianGrid", "GridField", "reduce"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Points an axis of the stencil.
INTERPOLATIONS = {"linear": 2, "cubic": 4}

#: Spacings from a control point up to which nodes are evaluated directly, and over which they are blended.
_DIRECT, _BLEND = 2.0, 1.0
#: Spacings tried, as shares of the domain's longest side.
_SHARES = 2.0 ** -np.arange(2.0, 8.01, 0.5)
#: Nodes from which the number of direct ones is estimated.
_SAMPLE = 2000


@dataclass(frozen=True, eq=False)
class CartesianGrid:
    """Points ``origin + spacing · index``; every place of the grid's box has a stencil.

    Attributes
    ----------
    origin : (3,) array, mesh length unit
        Absent axes at 0.
    spacing : float, mesh length unit
    shape : (3,) int64 array
        Points along each axis; 1 for an absent axis.
    interpolation : str
        A key of :data:`INTERPOLATIONS`.
    """

    origin: Floats
    spacing: float
    shape: Indices
    interpolation: str = "cubic"

    @classmethod
    def around(cls, points: Floats, spacing: float, interpolation: str = "cubic") -> CartesianGrid:
        """The grid that covers points (n, d), with room for the stencil.

        Raises
        ------
        InvalidInput
            If the interpolation is unknown.
        """
        if interpolation not in INTERPOLATIONS:
            raise InvalidInput(
                f"unknown interpolation {interpolation!r}", hint=f"known are {', '.join(INTERPOLATIONS)}"
            )
        d = points.shape[1]
        origin, shape = np.zeros(3), np.ones(3, dtype=np.int64)
        low, high = points.min(axis=0), points.max(axis=0)
        origin[:d] = low - spacing
        shape[:d] = np.floor((high - low) / spacing).astype(np.int64) + 4
        return cls(origin, spacing, shape, interpolation)

    def places(self, points: Floats) -> Floats:
        """(n, 3) coordinates of points (n, d) in spacings, within the grid; points outside are moved to its edge."""
        d = points.shape[1]
        out = np.zeros((len(points), 3))
        out[:, :d] = np.clip((points - self.origin[:d]) / self.spacing, 1.0, self.shape[:d] - 2.0 - 1e-9)
        return out

    def asked(self, places: Floats) -> Indices:
        """(g,) flat numbers of the grid points that interpolation at the places (n, 3) needs, ascending."""
        marked = np.zeros(int(np.prod(self.shape)), dtype=np.bool_)
        kernels.mark_stencils(places, self.shape, INTERPOLATIONS[self.interpolation], marked)
        return np.flatnonzero(marked)

    def points(self, numbers: Indices, d: int) -> Floats:
        """(g, d) coordinates of grid points."""
        index = np.stack(np.unravel_index(numbers, tuple(self.shape)), axis=1)[:, :d]
        return np.asarray(self.origin[:d] + self.spacing * index)

    def interpolate(self, places: Floats, numbers: Indices, values: Floats) -> Floats:
        """(n, k) values at the places (n, 3) from values (g, k) at the grid points ``numbers`` (g,)."""
        rows = np.zeros(int(np.prod(self.shape)), dtype=np.int64)
        rows[numbers] = np.arange(len(numbers))
        out = np.empty((len(places), values.shape[1]))
        kernels.interpolate_on_grid(places, self.shape, INTERPOLATIONS[self.interpolation], rows, values, out)
        return out


@dataclass(frozen=True, eq=False)
class GridField:
    """The field of a background grid.

    Attributes
    ----------
    boundary : (nb, d) array, mesh length unit
        Control points; near them the standard field itself is evaluated.
    """

    boundary: Floats
    grid: CartesianGrid
    standard: Field

    def __call__(self, points: Floats) -> VolumeDisplacement:
        """Displacement of points (n, d); within two spacings of a control point exactly the standard one."""
        h = self.grid.spacing
        limit = (_DIRECT + _BLEND) * h
        distance = cKDTree(self.boundary).query(points, distance_upper_bound=limit)[0]
        direct, gridded = distance < limit, distance > _DIRECT * h
        places = self.grid.places(points[gridded])
        numbers = self.grid.asked(places)
        sums = self.standard(np.vstack([points[direct], self.grid.points(numbers, points.shape[1])]))
        n = int(np.count_nonzero(direct))
        out = np.zeros_like(points)
        out[gridded] = self.grid.interpolate(places, numbers, np.ascontiguousarray(sums[n:]))
        share = restriction(np.maximum(distance[direct] / h - _DIRECT, 0.0) / _BLEND)[:, None]
        out[direct] = np.where(share == 1.0, sums[:n], share * sums[:n] + (1.0 - share) * out[direct])
        return VolumeDisplacement(out, direct, len(sums), len(self.boundary))


def reduce(problem: VolumeProblem) -> VolumeField:
    """Cover the mesh with a grid."""
    spacing = problem.length or _cheapest_spacing(problem)
    return GridField(problem.boundary, CartesianGrid.around(problem.nodes, spacing), problem.standard)


def _cheapest_spacing(problem: VolumeProblem) -> float:
    """The spacing with the fewest sums: with it the number of grid points falls and that of direct nodes rises."""
    sides = np.ptp(problem.nodes, axis=0)
    candidates = float(sides.max()) * _SHARES
    sample = problem.nodes[:: max(len(problem.nodes) // _SAMPLE, 1)]
    distance = np.sort(cKDTree(problem.boundary).query(sample)[0])
    direct = np.searchsorted(distance, (_DIRECT + _BLEND) * candidates) * (len(problem.nodes) / len(sample))
    grid = np.prod(np.floor(sides / candidates[:, None]) + 4.0, axis=1)
    return float(candidates[int(np.argmin(direct + grid))])
