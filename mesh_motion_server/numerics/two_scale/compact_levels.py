"""What the coarse field leaves at the boundary nodes, interpolated by compact functions, widest first.

One support radius serves a boundary whose spacing varies little. Where it varies much, functions as narrow as the
finest spacing would not reach from one node to the next elsewhere, and set that node alone. So there are levels: each
has a quarter of the radius of the one before, and the nodes that its radius can join; the last one has all nodes and
takes what is left, so that the sum is exact (the multistep method of Floater and Iske).

Each matrix is sparse and is solved by conjugate gradients with a factorized sparse approximate inverse, which is made
once for the reference mesh and serves the displaced ones.

References
----------
M. S. Floater, A. Iske, J. Comput. Appl. Math. 73 (1996) 65–78. L. Kedward, C. B. Allen, T. C. S. Rendall, J. Comput.
Phys. 345 (2017) 732–751.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from mesh_motion_server.errors import NumericalError
from mesh_motion_server.numerics.assembly import sparse_rows
from mesh_motion_server.numerics.centres import CentreLayout, padded
from mesh_motion_server.numerics.factorizations.conjugate_gradients import conjugate_gradients, largest
from mesh_motion_server.numerics.factorizations.preconditioner import SparseInverse
from mesh_motion_server.numerics.interpolant import Interpolant
from mesh_motion_server.numerics.kernels import basis_named
from mesh_motion_server.numerics.sparse_products import in_lanes, nbytes, product

__all__ = ["BASIS", "CompactLevel", "CompactSystem", "compact_levels"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

BASIS = basis_named("wendland-c2")
"""Compact, positive definite, with a gradient at its centres, whatever the basis of the coarse field is."""

#: Support radius of a level in the smallest spacing it serves, and that of the level before in its own.
_RADII, _RATIO = 3.0, 4.0
#: Least distance of a level's nodes in its spacing: a little less than the next radius, so that those that it does not
#: join are all taken. The closer nodes would multiply the entries of every matrix and carry nothing further.
_SEPARATION = 0.7
#: Share of the nodes whose spacing may be smaller than what sets a radius: single close pairs do not.
_CLOSE, _WIDE = 5.0, 95.0
_NEIGHBOURS = 16  # preceding points a row of the preconditioner
#: Of the largest value interpolated, of which the coarse field leaves a hundredth or less; and for a wide level, which
#: between its nodes leaves a ten-thousandth to the next one anyway.
_TOLERANCE, _WIDE_TOLERANCE = 1e-11, 1e-7
_MAX_ITERATIONS = 200
_ACCEPTED = 1e-9


@dataclass(frozen=True, eq=False)
class CompactLevel:
    """What a level keeps over all states of the mesh.

    Attributes
    ----------
    members : (m,) int64 array
        Its control points.
    radius : float, mesh length unit
    precondition : SparseInverse
        Of the reference mesh.
    """

    members: Indices
    radius: float
    precondition: SparseInverse


def compact_levels(points: Floats, spacing: Floats, moving: NDArray[np.bool_]) -> list[CompactLevel]:
    """The levels for reference control points, widest first.

    Parameters
    ----------
    points : (n, 3) array, mesh length unit
    spacing : (n,) array, mesh length unit
    moving : (n,) bool array
        Those whose spacings count. At nodes at rest little is left to correct, so setting them alone does no harm.
    """
    low, high = np.percentile(spacing[moving], [_CLOSE, _WIDE], method="nearest")
    wider = max(math.ceil(math.log(high / low, _RATIO)) - 1, 0)
    levels = []
    for scale in float(low) * _RATIO ** np.arange(wider, 0, -1):
        members = _separated(points, _SEPARATION * scale)
        if 1 < len(members) < len(points):
            levels.append(_level(points, members, _RADII * scale))
    levels.append(_level(points, np.arange(len(points)), _RADII * float(low)))
    return levels


def _separated(points: Floats, separation: float) -> Indices:
    """Points (m,) of which no two are closer than the separation: the first one left, again and again."""
    # one of each cell, first, keeps the pairs few; those further apart than its diagonal are all there
    cells = np.floor((points - points.min(axis=0)) * (np.sqrt(3.0) / separation)).astype(np.int64)
    candidates: Indices = np.sort(np.unique(cells, axis=0, return_index=True)[1])
    pairs = cKDTree(points[candidates]).query_pairs(separation, output_type="ndarray")
    taken = np.full(len(candidates), True)
    _drop_followers(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))], taken)
    return np.asarray(candidates[taken])


@njit(cache=True)
def _drop_followers(pairs: Indices, taken: NDArray[np.bool_]) -> None:
    """Clear ``taken`` of the second of every pair (p, 2) of which the first is taken; pairs in order of the first."""
    for p in range(len(pairs)):
        if taken[pairs[p, 0]]:
            taken[pairs[p, 1]] = False


def _level(points: Floats, members: Indices, radius: float) -> CompactLevel:
    return CompactLevel(members, radius, SparseInverse(points[members], BASIS, radius, _NEIGHBOURS))


@dataclass(frozen=True, eq=False)
class CompactSystem:
    """A level's matrix at one state of the mesh.

    Attributes
    ----------
    level : CompactLevel
    points : (m, d) array, mesh length unit
        The members' positions.
    layout : CentreLayout
    matrix : (m, m) csr_array
        Rows and columns in the members' order, which is the preconditioner's.
    """

    level: CompactLevel
    points: Floats
    layout: CentreLayout
    matrix: csr_array

    @classmethod
    def build(cls, level: CompactLevel, points: Floats) -> CompactSystem:
        """Assemble a level for all control points (n, d)."""
        members = np.ascontiguousarray(points[level.members])
        layout = CentreLayout.build(members, BASIS, level.radius)
        return cls(level, members, layout, sparse_rows(layout, BASIS, level.radius, padded(members)))

    @property
    def nbytes(self) -> int:
        return nbytes(self.matrix) + self.points.nbytes + self.layout.coordinates.nbytes

    def solve(self, residual: Floats, scale: float, *, last: bool = True) -> tuple[Interpolant, int]:
        """The interpolant of a residual (n, k) of all control points at the members, and the iterations it took.

        Parameters
        ----------
        residual : (n, k) array
        scale : float
            Largest value to be interpolated, by whatever: what the solution's error is measured by.
        last : bool
            Whether no other level takes what is left.

        Raises
        ------
        NumericalError
            If the residual stays above 1e-9 of the scale, or for a level before the last above 1e-7.
        """
        found, iterations = self._conjugate_gradients(
            in_lanes(residual[self.level.members]), scale, _TOLERANCE if last else _WIDE_TOLERANCE
        )
        weights = np.ascontiguousarray(found[:, : residual.shape[1]])
        return Interpolant(self.points, weights, BASIS, self.level.radius, self.layout), iterations

    def _conjugate_gradients(self, right: Floats, scale: float, tolerance: float) -> tuple[Floats, int]:
        """Solution (m, k); all columns advance together."""
        if scale == 0.0:
            return np.zeros_like(right), 0
        found = conjugate_gradients(
            right,
            apply=lambda vectors: product(self.matrix, vectors),
            precondition=self.level.precondition,
            done=lambda left: largest(left) <= tolerance * scale,
            most=_MAX_ITERATIONS,
        )
        reached = largest(found.residual) / scale
        if reached > max(_ACCEPTED, tolerance):
            raise NumericalError(
                f"the near-surface interpolation stopped at a relative residual of {reached:.1e}",
                hint="separate boundary nodes that nearly coincide, or take another solver than 'two-scale'",
            )
        return found.solution, found.iterations
