"""Evaluation of an interpolant and its gradient at many points.

An interpolant in two scales is a spline plus sums over few near centres; any other interpolant is a sum over all
centres. Sums are direct or cell by cell, in compiled threads, with memory for the result only. The value at a point
depends on the interpolant and that point alone: bitwise the same for any number of threads and for any way to split the
points into calls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mesh_motion_kernels as kernels
import numpy as np
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.interpolation.assembly import rows_near, sparse_rows
from mesh_motion_numerics.interpolation.interpolant import Interpolant
from mesh_motion_numerics.interpolation.kernels import require_gradient
from mesh_motion_numerics.interpolation.sparse_rows import SparseRows
from mesh_motion_numerics.interpolation.two_scale.interpolant import AnyInterpolant, TwoScaleInterpolant
from mesh_motion_numerics.interpolation.two_scale.nested_grid import NestedSpline
from mesh_motion_numerics.mesh.points import padded


@dataclass(frozen=True, eq=False)
class NearOperator:
    """The values of all functions of a compact level at given places, as a sparse matrix.

    Few places are within reach of a level, and each of them is near few centres. The matrix depends only on centres and
    places, so it is made once for a state of the mesh and used for all displacements from this state.
    """

    #: (r,). Places that the level may reach, with neighbours next to each other; at all other places the level is 0.
    rows: Integers
    matrix: SparseRows  # Values of the level's functions there

    @classmethod
    def build(cls, level: Interpolant, points: Floats, *, skipped: Integers | None = None) -> NearOperator:
        """The operator of a compact level, whatever its weights, at points (n, d) except the rows ``skipped`` (u,)."""
        rows, near = rows_near(level.layout, level.support_radius, points, skipped=skipped)
        return cls(rows, sparse_rows(level.layout, level.basis, level.support_radius, near))

    def add(self, weights: Floats, out: Floats) -> None:
        """Add the level with weights (nc, k) to ``out`` (n, k)."""
        kernels.add_product(self.rows, *self.matrix, np.ascontiguousarray(weights), out)

    def transpose(self, weights: Floats, centres: int) -> Floats:
        """The transpose: (nc, k) derivatives by the weights of the ``centres``, for (n, k) weights of the values."""
        out = np.empty((centres, weights.shape[1]))
        kernels.transposed_product(self.rows, *self.matrix, np.ascontiguousarray(weights), out)
        return out


def displacement(
    field: AnyInterpolant | NestedSpline, points: Floats, prepared: Sequence[NearOperator] | None = None
) -> Floats:
    """(n, k) values of an interpolant, or of a spline, at (n, d) points, thesis (2.5).

    Raises InvalidInput if the points' dimension is not the interpolant's.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    prepared : sequence of NearOperator, optional
        Of each compact level at these points, made for an interpolant of the same factorization. The values are bitwise
        the same with and without it, except at the rows that the operators skip.
    """
    if isinstance(field, TwoScaleInterpolant):
        out = displacement(field.coarse, points)
        near = [NearOperator.build(level, points) for level in field.levels] if prepared is None else prepared
        # one level after the other, prepared or not: another order would change the last bits of the sum
        for level, operator in zip(field.levels, near, strict=True):
            operator.add(level.weights, out)
        return out
    _check_dimension(field, points)
    if isinstance(field, NestedSpline):
        return field.values(points)
    layout, weights = field.layout, field.weights[field.layout.order]  # centres are stored cell by cell
    out = layout.product(field.basis, field.support_radius, padded(points), weights)
    if field.polynomial is not None:
        out += field.polynomial(points)
    return out


def gradient(field: AnyInterpolant | NestedSpline, points: Floats) -> Floats:
    """(n, k, d) gradients ``[i, c, m] = ∂u_c/∂x_m`` at (n, d) points.

    Raises InvalidInput if the basis has no gradient at its centres, or the points' dimension is not the interpolant's.
    """
    if isinstance(field, TwoScaleInterpolant):
        out = gradient(field.coarse, points)
        for level in field.levels:
            near = level.layout.within_reach(points)
            out[near] += gradient(level, points[near])
        return out
    _check_dimension(field, points)
    if isinstance(field, NestedSpline):
        return field.gradients(points)
    require_gradient(field.basis)
    out = np.empty((len(points), field.components, points.shape[1]))
    layout = field.layout
    centres = layout.coordinates, np.ascontiguousarray(field.weights[layout.order].T)
    kernels.sum_gradients(field.basis.code, padded(points), *centres, 1.0 / field.support_radius, *layout.grid, out)
    if field.polynomial is not None:
        out += field.polynomial.gradient
    return out


def _check_dimension(field: Interpolant | NestedSpline, points: Floats) -> None:
    """Refuse points whose shape is not (n, d)."""
    dimension = field.dimension if isinstance(field, NestedSpline) else field.control_points.shape[1]
    if points.ndim != 2 or points.shape[1] != dimension:
        raise InvalidInput(
            f"expected points of shape (n, {dimension}), got {points.shape}", code="INVALID_ARGUMENT.SHAPE"
        )
