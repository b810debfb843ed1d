"""Evaluation of an interpolant and its gradient at many points, behind one small interface.

An interpolant in two scales is a spline plus sums over few near centres; any other interpolant is a sum over all
centres.

:class:`LocalEvaluator` sums over centres on the threads of this machine. Anything else that gives the same two arrays
(a far-field grid, workers of an engine that have the points) is an :class:`Evaluator` too.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import mesh_motion_kernels as kernels
import numpy as np

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.arrays import Floats, Integers
from mesh_motion_server.numerics.interpolation.interpolant import Interpolant
from mesh_motion_server.numerics.interpolation.kernels import require_gradient
from mesh_motion_server.numerics.interpolation.two_scale.interpolant import AnyInterpolant, TwoScaleInterpolant
from mesh_motion_server.numerics.interpolation.two_scale.near_operator import NearOperator
from mesh_motion_server.numerics.interpolation.two_scale.nested_grid import NestedSpline
from mesh_motion_server.numerics.mesh.points import padded
from mesh_motion_server.numerics.threads import checked_threads, limited_to

__all__ = ["Evaluator", "LocalEvaluator", "NearOperators", "Prepared", "PreparingEvaluator"]


class Prepared(Protocol):
    """What is computed once and may be cached: of an evaluator, what does not depend on the weights."""

    @property
    def nbytes(self) -> int:
        """Memory it holds."""
        ...


class Evaluator(Protocol):
    """Gives an interpolant's values and gradients at points."""

    def displacement(self, interpolant: AnyInterpolant, points: Floats) -> Floats:
        """(n, k) values at (n, d) points."""
        ...

    def gradient(self, interpolant: AnyInterpolant, points: Floats) -> Floats:
        """(n, k, d) gradients ``[i, c, m] = ∂u_c/∂x_m`` at (n, d) points."""
        ...


@runtime_checkable
class PreparingEvaluator(Evaluator, Protocol):
    """An evaluator that saves work if many interpolants of the same control points are evaluated at the same points."""

    def prepare(self, interpolant: TwoScaleInterpolant, points: Floats, *, unasked: Integers | None = None) -> Prepared:
        """Compute what depends only on the interpolant's control points and on (n, d) points.

        The values at the rows ``unasked`` (r,) will not be used.
        """
        ...

    def displacement(self, interpolant: AnyInterpolant, points: Floats, prepared: Prepared | None = None) -> Floats:
        """(n, k) values at (n, d) points, bitwise the same with and without ``prepared``.

        Except at the rows that were ``unasked`` in :meth:`prepare`.
        """
        ...


@dataclass(frozen=True, eq=False)
class NearOperators:
    """What :class:`LocalEvaluator` prepares for an interpolant in two scales: one operator per compact level."""

    operators: tuple[NearOperator, ...]

    @property
    def nbytes(self) -> int:
        """Memory they hold."""
        return sum(operator.nbytes for operator in self.operators)


class LocalEvaluator:
    """Direct or cell-by-cell sums in compiled threads; memory for the result only.

    The value at a point depends on the interpolant and that point alone: bitwise the same for any number of threads and
    for any way to split the points into calls.

    Parameters
    ----------
    threads : int, optional
        At most :func:`~mesh_motion_kernels.available_threads`, which is the default.
    """

    def __init__(self, threads: int | None = None) -> None:
        self._threads = checked_threads(threads)

    def prepare(
        self, interpolant: TwoScaleInterpolant, points: Floats, *, unasked: Integers | None = None
    ) -> NearOperators:
        """The compact levels' operators at (n, d) points; at the rows ``unasked`` (r,) the operators are zero.

        Raises
        ------
        InvalidInput
            If the points' dimension is not the interpolant's.
        """
        _check_dimension(interpolant, points)
        return NearOperators(
            tuple(
                NearOperator.build(level, points, unasked=unasked, threads=self._threads)
                for level in interpolant.levels
            )
        )

    def displacement(self, interpolant: AnyInterpolant, points: Floats, prepared: Prepared | None = None) -> Floats:
        """(n, k) values at (n, d) points, thesis (2.5).

        Parameters
        ----------
        points : (n, d) array, mesh length unit
        prepared : NearOperators, optional
            Of :meth:`prepare` for these points and for an interpolant of the same factorization.

        Raises
        ------
        InvalidInput
            If the points' dimension is not the interpolant's.
        """
        out = np.empty((len(points), interpolant.components))
        if isinstance(interpolant, TwoScaleInterpolant):
            near = prepared if isinstance(prepared, NearOperators) else self.prepare(interpolant, points)
            self._coarse_values(interpolant.coarse, points, out)
            for level, operator in zip(interpolant.levels, near.operators, strict=True):
                operator.add(level.weights, out, threads=self._threads)
            return out
        self._sum(kernels.sum_values, interpolant, points, out)
        if interpolant.polynomial is not None:
            out += interpolant.polynomial(points)
        return out

    def _coarse_values(self, coarse: NestedSpline | Interpolant, points: Floats, out: Floats) -> None:
        """Fill ``out`` (n, k) with a coarse field at (n, d) points."""
        if isinstance(coarse, Interpolant):
            out[:] = self.displacement(coarse, points)
            return
        with limited_to(self._threads):
            coarse.values(points, out)

    def gradient(self, interpolant: AnyInterpolant, points: Floats) -> Floats:
        """(n, k, d) gradients ``[i, c, m] = ∂u_c/∂x_m`` at (n, d) points.

        Raises
        ------
        InvalidInput
            If the basis has no gradient at its centres, or the points' dimension is not the interpolant's.
        """
        require_gradient(interpolant.basis)
        out = np.empty((len(points), interpolant.components, interpolant.dimension))
        if isinstance(interpolant, TwoScaleInterpolant):
            _check_dimension(interpolant, points)
            if isinstance(interpolant.coarse, Interpolant):
                out[:] = self.gradient(interpolant.coarse, points)
            else:
                with limited_to(self._threads):
                    interpolant.coarse.gradients(points, out)
            for level in interpolant.levels:
                near = level.layout.within_reach(points, threads=self._threads)
                out[near] += self.gradient(level, points[near])
            return out
        self._sum(kernels.sum_gradients, interpolant, points, out)
        if interpolant.polynomial is not None:
            out += interpolant.polynomial.gradient
        return out

    def _sum(self, kernel: Callable[..., None], interpolant: Interpolant, points: Floats, out: Floats) -> Floats:
        """Run a compiled sum over the interpolant's centres."""
        _check_dimension(interpolant, points)
        weights = interpolant.layout.sort(interpolant.weights)
        return interpolant.layout.sum(
            kernel, interpolant.basis, interpolant.support_radius, padded(points), weights, out, threads=self._threads
        )


def _check_dimension(interpolant: AnyInterpolant, points: Floats) -> None:
    """Refuse points whose shape is not (n, d)."""
    if points.ndim != 2 or points.shape[1] != interpolant.dimension:
        raise InvalidInput(
            f"expected points of shape (n, {interpolant.dimension}), got {points.shape}",
            code="INVALID_ARGUMENT.SHAPE",
        )
