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
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from mesh_motion_protocol.errors import QualityRefused

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.interpolation.assembly import SparseRows, sparse_rows
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.factorizations.conjugate_gradients import largest
from mesh_motion_numerics.interpolation.factorizations.preconditioner import SparseInverse
from mesh_motion_numerics.interpolation.interpolant import Interpolant
from mesh_motion_numerics.interpolation.kernels import basis_named
from mesh_motion_numerics.interpolation.sparse_products import nbytes
from mesh_motion_numerics.interpolation.two_scale.coarse_points import separated_points
from mesh_motion_numerics.mesh.points import padded

__all__ = [
    "BASIS",
    "CLOSEST",
    "LEVEL_RADII",
    "LEVEL_RATIO",
    "MAX_LEVELS",
    "CompactLevel",
    "CompactSystem",
    "compact_levels",
    "levels_below",
]


BASIS = basis_named("wendland-c2")
"""Compact, positive definite, with a gradient at its centres, whatever the basis of the coarse field is."""

#: Support radius of a level in the smallest spacing it serves, and that of the level before in its own.
_RADII, LEVEL_RATIO = 3.0, 4.0
#: The same of the few nodes that a coarse field of all others leaves out, by dimension. Wider is smoother, and few
#: nodes are cheap: an aerofoil that bends in a C-grid turns the edges of its first cells by 1.2° with 16 or with one
#: wide level of all nodes, and by 2.0° with 3.
LEVEL_RADII = {1: 16.0, 2: 16.0, 3: 6.0}
#: Gaps between coarse points for each scale of the widest level, at least.
_GAP = 6.0
#: The last level joins nodes that are this much closer than its scale.
CLOSEST = 16.0
#: Enough for spacings from the extent of a mesh down to its rounding.
MAX_LEVELS = 32
_ROUNDING = 1e-9
#: Least distance of a level's nodes in its spacing: a little less than the next radius, so that those that it does not
#: join are all taken. The closer nodes would multiply the entries of every matrix and carry nothing further.
_SEPARATION = 0.7
#: Share of the nodes whose spacing may be smaller than what sets a radius: single close pairs do not.
_CLOSE, _WIDE = 5.0, 95.0
_NEIGHBOURS = 16  # preceding points a row of the preconditioner
#: Of the largest value interpolated, of which the coarse field leaves a hundredth or less; and for a wide level, which
#: between its nodes leaves a ten-thousandth to the next one anyway.
_TOLERANCE, _WIDE_TOLERANCE = 1e-11, 1e-6
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

    members: Integers
    radius: float
    precondition: SparseInverse


def compact_levels(
    points: Floats, spacing: Floats, moving: Marks, *, coarse: Integers, gap: float
) -> list[CompactLevel]:
    """The levels of a boundary with many nodes, widest first, by the spacing of what moves.

    Parameters
    ----------
    points : (n, 3) array, mesh length unit
        Distinct reference control points.
    spacing : (n,) array, mesh length unit
    moving : (n,) bool array
        Those whose spacings count. At nodes at rest little is left to correct, so setting them alone does no harm.
    coarse : (c,) int64 array
        Points of the coarse field.
    gap : float, mesh length unit
        Largest distance of a point from the nearest coarse one.
    """
    low, high = np.percentile(spacing[moving], [_CLOSE, _WIDE], method="nearest")
    wider = max(math.ceil(math.log(max(high, gap / _GAP) / low, LEVEL_RATIO)) - 1, 0)
    return _levels(points, spacing, _nested(points, float(low) * LEVEL_RATIO**wider, coarse), float(low), _RADII)


def levels_below(points: Floats, spacing: Floats, separation: float, *, coarse: Integers) -> list[CompactLevel]:
    """The levels for points that the coarse field leaves out because they are closer than the separation to its own.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
        Distinct reference control points.
    spacing : (n,) array, mesh length unit
    separation : float, mesh length unit
    coarse : (c,) int64 array
    """
    radii = LEVEL_RADII[points.shape[1]]
    scale = separation / LEVEL_RATIO
    return _levels(padded(points), spacing, _nested(padded(points), scale, coarse), scale, radii)


def _nested(points: Floats, widest: float, first: Integers) -> Iterator[tuple[float, Integers]]:
    """Scales, each a quarter of the one before, and points (m,) as far apart; those of one are among the next ones."""
    for level in range(MAX_LEVELS):
        scale = widest / LEVEL_RATIO**level
        first = separated_points(points, _SEPARATION * scale, first)
        yield scale, first


def _levels(
    points: Floats, spacing: Floats, nested: Iterator[tuple[float, Integers]], low: float, radii: float
) -> list[CompactLevel]:
    """Levels until no two points are much closer than the scale: the last one has all points.

    Above the scale ``low`` a level needs two points that are not all; below it, points that the one before had not.
    """
    levels: list[CompactLevel] = []
    closest, before = float(spacing.min()), 0
    for scale, members in nested:
        if scale <= (1.0 + _ROUNDING) * low and scale <= CLOSEST * closest:
            break
        if (1 < len(members) < len(points)) if scale > (1.0 + _ROUNDING) * low else (len(members) > before):
            levels.append(_level(points, members, radii * scale))
            before = len(members)
    levels.append(_level(points, np.arange(len(points)), radii * scale))
    return levels


def _level(points: Floats, members: Integers, radius: float) -> CompactLevel:
    return CompactLevel(members, radius, SparseInverse(points[members], BASIS, radius, _NEIGHBOURS))


@dataclass(frozen=True, eq=False)
class CompactSystem:
    """A level's matrix at one state of the mesh.

    Attributes
    ----------
    points : (m, d) array, mesh length unit
        The members' positions.
    matrix : SparseRows
        Rows and columns in the members' order, which is the preconditioner's.
    """

    level: CompactLevel
    points: Floats
    layout: CentreLayout
    matrix: SparseRows

    @classmethod
    def build(cls, level: CompactLevel, points: Floats) -> CompactSystem:
        """Assemble a level for all control points (n, d)."""
        members = points.take(level.members, axis=0)
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
        QualityRefused
            If the residual stays above 1e-9 of the scale, or for a level before the last above 1e-6.
        """
        weights, iterations = self.weights(
            residual.take(self.level.members, axis=0), scale, _TOLERANCE if last else _WIDE_TOLERANCE
        )
        return self.interpolant(weights), iterations

    def interpolant(self, weights: Floats) -> Interpolant:
        """The level's function with weights (m, k)."""
        return Interpolant(self.points, weights, BASIS, self.level.radius, self.layout)

    def weights(self, right: Floats, scale: float, tolerance: float) -> tuple[Floats, int]:
        """The weights (m, k) that take the values ``right`` (m, k) at the members, and the iterations.

        All columns advance together until the residual is below the ``tolerance``, in units of the ``scale``.

        Raises
        ------
        QualityRefused
            As for :meth:`solve`.
        """
        if scale == 0.0:
            return np.zeros_like(right), 0
        taken = 0
        for precondition in self._preconditioners():
            found = precondition.conjugate_gradients(self.matrix, right, limit=tolerance * scale, most=_MAX_ITERATIONS)
            taken += found.iterations
            reached = largest(found.residual) / scale
            if reached <= max(_ACCEPTED, tolerance):
                return found.solution, taken
        raise QualityRefused(
            f"the near-surface interpolation stopped at a relative residual of {reached:.1e}",
            code="FAILED_PRECONDITION",
            hint="separate boundary nodes that nearly coincide",
        )

    def _preconditioners(self) -> Iterator[SparseInverse]:
        """The reference mesh's; where the boundary has changed too much for it, one of the boundary as it is."""
        yield self.level.precondition
        yield SparseInverse(padded(self.points), BASIS, self.level.radius, _NEIGHBOURS)
