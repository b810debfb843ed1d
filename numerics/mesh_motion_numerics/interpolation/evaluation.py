"""Evaluation of an interpolant and its gradient at many points.

An interpolant in two scales is a spline plus sums over few near centres; any other interpolant is a sum over all
centres. Sums are direct or cell by cell, in compiled threads, with memory for the result only. The value at a point
depends on the interpolant and that point alone: bitwise the same for any number of threads and for any way to split the
points into calls.
"""

import mesh_motion_kernels as kernels
import numpy as np
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.interpolation.interpolant import Interpolant
from mesh_motion_numerics.interpolation.kernels import require_gradient
from mesh_motion_numerics.interpolation.two_scale.interpolant import AnyInterpolant, TwoScaleInterpolant
from mesh_motion_numerics.interpolation.two_scale.near_operator import NearOperator
from mesh_motion_numerics.mesh.points import padded

__all__ = ["NearOperators", "displacement", "gradient", "prepare"]


NearOperators = tuple[NearOperator, ...]
"""The data of an interpolant in two scales that depend only on control points and points: one operator a level."""


def prepare(
    interpolant: TwoScaleInterpolant,
    points: Floats,
    *,
    skipped: Integers | None = None,
) -> NearOperators:
    """The compact levels' operators at (n, d) points; at the rows ``skipped`` (r,) the operators are zero.

    It saves work if many interpolants of the same control points are evaluated at the same points. Raises InvalidInput
    if the points' dimension is not the interpolant's.
    """
    _check_dimension(interpolant, points)
    return tuple(NearOperator.build(level, points, skipped=skipped) for level in interpolant.levels)


def displacement(
    interpolant: AnyInterpolant,
    points: Floats,
    prepared: NearOperators | None = None,
) -> Floats:
    """(n, k) values at (n, d) points, thesis (2.5).

    Raises InvalidInput if the points' dimension is not the interpolant's.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    prepared : NearOperators, optional
        Result of :func:`prepare` for these points and for an interpolant of the same factorization. The values are
        bitwise the same with and without it, except at the ``skipped`` rows.
    """
    if isinstance(interpolant, Interpolant):
        _check_dimension(interpolant, points)
        layout, weights = interpolant.layout, interpolant.weights[interpolant.layout.order]
        out = layout.product(interpolant.basis, interpolant.support_radius, padded(points), weights)
        if interpolant.polynomial is not None:
            out += interpolant.polynomial(points)
        return out
    near = prepare(interpolant, points) if prepared is None else prepared
    out = np.empty((len(points), interpolant.components))
    if isinstance(interpolant.coarse, Interpolant):
        out[:] = displacement(interpolant.coarse, points)
    else:
        interpolant.coarse.values(points, out)
    for level, operator in zip(interpolant.levels, near, strict=True):
        operator.add(level.weights, out)
    return out


def gradient(interpolant: AnyInterpolant, points: Floats) -> Floats:
    """(n, k, d) gradients ``[i, c, m] = ∂u_c/∂x_m`` at (n, d) points.

    Raises InvalidInput if the basis has no gradient at its centres, or the points' dimension is not the interpolant's.
    """
    require_gradient(interpolant.basis)
    _check_dimension(interpolant, points)
    out = np.empty((len(points), interpolant.components, interpolant.dimension))
    if isinstance(interpolant, Interpolant):
        layout = interpolant.layout
        centres = layout.coordinates, np.ascontiguousarray(interpolant.weights[layout.order].T)
        scale = 1.0 / interpolant.support_radius
        kernels.sum_gradients(interpolant.basis.code, padded(points), *centres, scale, *layout.grid, out)
        if interpolant.polynomial is not None:
            out += interpolant.polynomial.gradient
        return out
    if isinstance(interpolant.coarse, Interpolant):
        out[:] = gradient(interpolant.coarse, points)
    else:
        interpolant.coarse.gradients(points, out)
    for level in interpolant.levels:
        near = level.layout.within_reach(points)
        out[near] += gradient(level, points[near])
    return out


def _check_dimension(interpolant: AnyInterpolant, points: Floats) -> None:
    """Refuse points whose shape is not (n, d)."""
    if points.ndim != 2 or points.shape[1] != interpolant.dimension:
        raise InvalidInput(
            f"expected points of shape (n, {interpolant.dimension}), got {points.shape}",
            code="INVALID_ARGUMENT.SHAPE",
        )
