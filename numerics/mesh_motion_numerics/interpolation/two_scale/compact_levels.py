"""The coarse field's residual at the boundary nodes, interpolated by compact functions, widest first.

If the spacing of a boundary varies little, one support radius is enough. If it varies much, functions as narrow as the
finest spacing would not reach from one node to the next where the spacing is coarse, and would move single nodes only.
So there are levels: each has a quarter of the radius of the level before, and the nodes that its radius can connect.
The last level has all nodes and interpolates the remaining residual, so that the sum is exact (the multistep method of
Floater and Iske).

Each system is sparse and is solved by conjugate gradients with a factorized sparse approximate inverse. This inverse is
made once for the reference mesh, if a level needs it, and also used for displaced meshes.

References
----------
M. S. Floater, A. Iske, J. Comput. Appl. Math. 73 (1996) 65–78. L. Kedward, C. B. Allen, T. C. S. Rendall, J. Comput.
Phys. 345 (2017) 732–751.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from mesh_motion_protocol.errors import QualityRefused

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.interpolation.assembly import sparse_rows
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.factorizations.preconditioner import SparseInverse
from mesh_motion_numerics.interpolation.interpolant import Interpolant
from mesh_motion_numerics.interpolation.kernels import basis_named
from mesh_motion_numerics.interpolation.sparse_rows import Elimination, SparseCholesky, SparseRows
from mesh_motion_numerics.interpolation.two_scale.coarse_points import separated_points
from mesh_motion_numerics.mesh.points import padded

BASIS = basis_named("wendland-c2")
"""The basis of the levels for every coarse field: compact, positive definite, with a gradient at its centres."""

#: Support radius of a level in units of its smallest spacing, and that of the level before in units of its own.
_RADII, LEVEL_RATIO = 3.0, 4.0
#: The same for the few nodes that a coarse field of all others leaves out, by dimension. A wider radius is smoother,
#: and cheap for few nodes: an aerofoil that bends in a C-grid turns the edges of its first cells by 1.2° with 16 or
#: with one wide level of all nodes, and by 2.0° with 3.
LEVEL_RADII = {1: 16.0, 2: 16.0, 3: 6.0}
#: Largest gap between coarse points, in units of the scale of the widest level.
_GAP = 6.0
#: The last level takes the remaining nodes if they are at most this much closer than its scale.
_CLOSEST = 16.0
#: Largest number of levels: enough for spacings from the extent of a mesh down to its rounding.
_MAX_LEVELS = 32
_ROUNDING = 1e-9
#: Smallest distance of a level's nodes in units of its spacing. It is a little less than the next radius, so that all
#: nodes are taken that the level does not connect. Closer nodes would multiply the entries of every matrix and bring no
#: gain.
_SEPARATION = 0.7
#: Share of the nodes whose spacing may be smaller than the one that sets a radius: single close pairs do not set it.
_CLOSE, _WIDE = 5.0, 95.0
_NEIGHBOURS = 16  # preceding points in a row of the preconditioner
#: Tolerances relative to the largest interpolated value, of which the coarse field leaves a hundredth or less; the
#: second for a wide level, which leaves a ten-thousandth to the next level anyway.
_TOLERANCE, _WIDE_TOLERANCE = 1e-11, 1e-6
#: Tolerance relative to the largest value if a transpose follows.
_EXACT = 1e-13
_MAX_ITERATIONS = 200
_ACCEPTED = 1e-9
#: Mean entries of a matrix row up to which a factorization is worth its time. On the wings of 6 000 and 18 000 nodes,
#: with 7 and 8 entries, it takes 14 and 72 ms and saves 5 of 6 and 17 of 19 ms in each solution; with 27 entries it
#: takes 290 ms and saves 6 of 15 ms.
_FEW = 12


@dataclass(frozen=True, eq=False)
class CompactLevel:
    """The data of a level that are kept over all states of the mesh."""

    members: Integers  # (m,). Its control points
    radius: float  # mesh length unit
    reference: Floats  # (m, 3), mesh length unit. The members' reference positions
    #: Whether a factor solves it, so that it is linear to rounding. Its nodes are few, and are factorized once.
    direct: bool = False

    @cached_property
    def precondition(self) -> SparseInverse:
        """Preconditioner of the reference mesh; made for the first solution that iterates."""
        return SparseInverse(self.reference, BASIS, self.radius, _NEIGHBOURS)


def compact_levels(
    points: Floats, spacing: Floats, moving: Marks, *, coarse: Integers, gap: float
) -> list[CompactLevel]:
    """The levels of a boundary with many nodes, widest first, chosen by the spacing of the moving nodes.

    Parameters
    ----------
    points : (n, 3) array, mesh length unit
        Distinct reference control points.
    spacing : (n,) array, mesh length unit
    moving : (n,) bool array
        Nodes whose spacings count. At nodes at rest the residual is small, so it does no harm if they are set singly.
    coarse : (c,) int64 array
        Points of the coarse field.
    gap : float, mesh length unit
        Largest distance of a point from the nearest coarse one.
    """
    low, high = np.percentile(spacing[moving], [_CLOSE, _WIDE], method="nearest")
    wider = max(math.ceil(math.log(max(high, gap / _GAP) / low, LEVEL_RATIO)) - 1, 0)
    scales = float(low), float(low) * LEVEL_RATIO**wider
    return _levels(points, float(spacing.min()), scales, coarse, _RADII)


def levels_of_all(points: Floats, spacing: Floats, moving: Marks, radii: float) -> list[CompactLevel]:
    """The levels of a boundary whose coarse field has all nodes but is smoothed, widest first.

    The same as :func:`compact_levels`, with the radius of a level in units of its spacing.
    """
    scales = scales_of_all(spacing, moving)
    levels = _levels(points, float(spacing.min()), scales, np.empty(0, np.int64), radii)
    return [replace(level, direct=True) for level in levels]


def levels_below(points: Floats, spacing: Floats, separation: float, *, coarse: Integers) -> list[CompactLevel]:
    """The levels for points that the coarse field leaves out because they are too close to its own points.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
        Distinct reference control points.
    spacing : (n,) array, mesh length unit
    separation : float, mesh length unit
    coarse : (c,) int64 array
    """
    scale, radii = separation / LEVEL_RATIO, LEVEL_RADII[points.shape[1]]
    return _levels(padded(points), float(spacing.min()), (scale, scale), coarse, radii)


def scales_of_all(spacing: Floats, moving: Marks) -> tuple[float, float]:
    """The narrowest and the widest scale of levels that have all nodes, mesh length unit.

    They are the spacings of the moving nodes where these are close and where they are not.
    """
    low, high = np.percentile(spacing[moving if moving.any() else ~moving], [_CLOSE, _WIDE], method="nearest")
    return float(low), float(low) * float(LEVEL_RATIO ** math.ceil(math.log(high / low, LEVEL_RATIO) - _ROUNDING))


def nested_members(
    count: int,
    closest: float,
    scales: tuple[float, float],
    first: Integers,
    separated: Callable[[float, Integers], Integers],
) -> Iterator[tuple[float, Integers]]:
    """Scales of levels, each a quarter of the one before, and the points (m,) of ``count`` that far apart.

    They end at a scale at which no two points are much closer: the last level has all points. Above the narrowest of
    the ``scales`` a level needs at least two points but not all; below it, points that the level before did not have.

    Parameters
    ----------
    closest : float, mesh length unit
        Smallest distance of two points.
    scales : (float, float), mesh length unit
        The narrowest and the widest.
    first : (f,) int64 array
        Points that every level has.
    separated : callable
        Returns the points at least that distance from each other, with given ones.
    """
    low, widest = scales
    before = 0
    for level in range(_MAX_LEVELS):
        scale = widest / LEVEL_RATIO**level
        if scale <= (1.0 + _ROUNDING) * low and scale <= _CLOSEST * closest:
            break
        first = separated(_SEPARATION * scale, first)
        if (1 < len(first) < count) if scale > (1.0 + _ROUNDING) * low else (len(first) > before):
            yield scale, first
            before = len(first)
    yield scale, np.arange(count)


def _levels(
    points: Floats, closest: float, scales: tuple[float, float], first: Integers, radii: float
) -> list[CompactLevel]:
    nested = nested_members(len(points), closest, scales, first, partial(separated_points, points))
    return [CompactLevel(members, radii * scale, points[members]) for scale, members in nested]


@dataclass(frozen=True, eq=False)
class CompactSystem:
    """A level's matrix at one state of the mesh."""

    level: CompactLevel
    points: Floats  # (m, d), mesh length unit. The members' positions
    layout: CentreLayout
    matrix: SparseRows  # Rows and columns in the members' order, which is the preconditioner's

    @classmethod
    def build(cls, level: CompactLevel, points: Floats) -> CompactSystem:
        """Assemble a level for all control points (n, d)."""
        members = points.take(level.members, axis=0)
        layout = CentreLayout.build(members, BASIS, level.radius)
        return cls(level, members, layout, sparse_rows(layout, BASIS, level.radius, padded(members)))

    def exactly(self, right: Floats) -> Floats:
        """The weights (m, k) that give the values ``right`` (m, k) at the members to rounding, as a transpose requires.

        Raises QualityRefused, as :meth:`solve` does.
        """
        if self._factor is not None:
            return self._factor.solve(right)
        return self.weights(right, float(np.abs(right).max(initial=0.0)), _EXACT)

    @cached_property
    def _factor(self) -> SparseCholesky | None:
        """The factor of the matrix, if its rows are short; made for the first exact solution."""
        if not self.level.direct and len(self.matrix.data) > _FEW * len(self.points):
            return None
        starts, columns, entries = self.matrix
        pattern = starts.astype(np.int64), columns
        return SparseCholesky.build(*pattern, entries.reshape(-1, 1, 1), Elimination.of(*pattern, self.points))

    def solve(self, residual: Floats, scale: float, *, last: bool = True) -> Interpolant:
        """Return the interpolant at the members of a residual (n, k) of all control points.

        Raises QualityRefused if the residual stays above 1e-9 of the scale, or for a level before the last above 1e-6.

        Parameters
        ----------
        residual : (n, k) array
        scale : float
            Largest value that all levels together interpolate; the solution's error is relative to it.
        last : bool
            Whether this is the last level, so that no other one interpolates the residual.
        """
        own = residual.take(self.level.members, axis=0)
        if self.level.direct:
            return self.interpolant(self.exactly(own))
        return self.interpolant(self.weights(own, scale, _TOLERANCE if last else _WIDE_TOLERANCE))

    def interpolant(self, weights: Floats) -> Interpolant:
        """The level's function with weights (m, k)."""
        return Interpolant(self.points, weights, BASIS, self.level.radius, self.layout)

    def weights(self, right: Floats, scale: float, tolerance: float) -> Floats:
        """The weights (m, k) that give the values ``right`` (m, k) at the members.

        All columns advance together until the residual is below the ``tolerance``, in units of the ``scale``.

        Raises QualityRefused, as :meth:`solve` does.
        """
        if scale == 0.0:
            return np.zeros_like(right)
        for precondition in self._preconditioners():
            found = precondition.conjugate_gradients(self.matrix, right, limit=tolerance * scale, most=_MAX_ITERATIONS)
            reached = float(np.abs(found.residual).max(initial=0.0)) / scale
            if reached <= max(_ACCEPTED, tolerance):
                return found.solution
        raise QualityRefused(
            f"the near-surface interpolation stopped at a relative residual of {reached:.1e}",
            code="FAILED_PRECONDITION",
            hint="separate boundary nodes that nearly coincide",
        )

    def _preconditioners(self) -> Iterator[SparseInverse]:
        """Yield the reference mesh's preconditioner, and if it fails one for the current boundary."""
        yield self.level.precondition
        yield SparseInverse(padded(self.points), BASIS, self.level.radius, _NEIGHBOURS)
