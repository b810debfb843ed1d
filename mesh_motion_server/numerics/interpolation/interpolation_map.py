"""An interpolation from control points to given places as a linear map, and the transpose of that map.

The map is the one that a motion applies: the same coarse points, levels, grid and polynomials. The transpose runs
through the same operations backwards, so ``⟨w, A v⟩ = ⟨Aᵀ w, v⟩`` holds to rounding, as an adjoint needs it. In two
scales the compact levels are solved more accurately than for a motion, where a residual is left to the next level.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import zip_longest
from typing import Protocol

import numpy as np

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.arrays import Floats, Integers
from mesh_motion_server.numerics.interpolation import evaluation
from mesh_motion_server.numerics.interpolation.centres import CentreLayout
from mesh_motion_server.numerics.interpolation.factor_source import FactorSource, MakeEachTime, prepared_for
from mesh_motion_server.numerics.interpolation.factorizations.conditional import NullSpaceCholesky
from mesh_motion_server.numerics.interpolation.interpolant import AllCentreFactorization, Factorization, Interpolant
from mesh_motion_server.numerics.interpolation.periodic_interpolant import PeriodicFactorization, PeriodicLevels
from mesh_motion_server.numerics.interpolation.two_scale.compact_levels import CompactSystem
from mesh_motion_server.numerics.interpolation.two_scale.factorization import TwoScaleFactorization
from mesh_motion_server.numerics.interpolation.two_scale.grid_sums import on_grid, on_grid_transposed
from mesh_motion_server.numerics.interpolation.two_scale.interpolant import TwoScaleInterpolant
from mesh_motion_server.numerics.interpolation.two_scale.near_operator import NearOperator

__all__ = ["InterpolationMap", "interpolation_map"]

#: Of the largest value: the residual at which a compact level is solved.
_TOLERANCE = 1e-13


class InterpolationMap(Protocol):
    """(nc, k) values at control points → (n, k) values at places; made by :func:`interpolation_map`."""

    def apply(self, values: Floats) -> Floats:
        """(n, k) values at the places."""
        ...

    def transpose(self, weights: Floats) -> Floats:
        """(nc, k) what the values at the control points count for (n, k) weights of those at the places."""
        ...


def interpolation_map(
    factorization: Factorization,
    places: Floats,
    factors: FactorSource | None = None,
    *,
    left_out: Integers | None = None,
) -> InterpolationMap:
    """The map of a factorization to (n, d) places.

    Parameters
    ----------
    factors : FactorSource, optional
        Where the compact levels' operators are found that a motion has made.
    left_out : (r,) int64 array, optional
        Places whose values do not count; their weights are zero.

    Raises
    ------
    InvalidInput
        If the control points are reduced: that map has no transpose.
    """
    if isinstance(factorization, AllCentreFactorization):
        return _OneScale(factorization, places)
    if isinstance(factorization, TwoScaleFactorization):
        return _TwoScales(
            factorization,
            places,
            MakeEachTime() if factors is None else factors,  # an empty cache is falsy
            np.empty(0, dtype=np.int64) if left_out is None else left_out,
        )
    if isinstance(factorization, PeriodicFactorization):
        return _Periodic(factorization, places)
    if isinstance(factorization, PeriodicLevels):
        return _PeriodicLevels(factorization, places)
    raise InvalidInput(f"an interpolation of the kind {factorization.solver!r} has no derivative")


@dataclass(frozen=True, eq=False)
class _OneScale:
    """All control points are centres."""

    factorization: AllCentreFactorization
    places: Floats

    def apply(self, values: Floats) -> Floats:
        return evaluation.displacement(self.factorization.solve(values), self.places)

    def transpose(self, weights: Floats) -> Floats:
        made = self.factorization
        sums = self._sums(weights)
        if isinstance(made.system, NullSpaceCholesky):
            linear = made.system.linear
            return made.system.solve_bordered(sums, linear.matrix(self.places).T @ weights)
        return made.system.solve(sums)

    def _sums(self, weights: Floats) -> Floats:
        """(nc, k) Φᵀ w: φ is symmetric, so the places are the centres of a sum at the control points."""
        made = self.factorization
        turned = Interpolant(self.places, weights, made.basis, made.support_radius, self._layout)
        return evaluation.displacement(turned, made.control_points)

    @cached_property
    def _layout(self) -> CentreLayout:
        return CentreLayout.build(self.places, self.factorization.basis, self.factorization.support_radius)


@dataclass(frozen=True, eq=False)
class _Periodic:
    """Each control point stands for its images; the components are those of vectors, which turn with them."""

    factorization: PeriodicFactorization
    places: Floats

    def apply(self, values: Floats) -> Floats:
        return evaluation.displacement(self.factorization.solve(values), self.places)

    def transpose(self, weights: Floats) -> Floats:
        made, images = self.factorization, self.factorization.images
        turned = Interpolant(self.places, weights, made.basis, made.support_radius, self._layout)
        of_images = evaluation.displacement(turned, images.places)
        sums = np.zeros((len(made.control_points), weights.shape[1]))
        if images.rotations is None:
            np.add.at(sums, images.owners, of_images)
            return made.system.solve(sums)
        np.add.at(sums, images.owners, np.einsum("iab,ia->ib", images.rotations, of_images))
        return made.system.solve(sums.reshape(-1, 1)).reshape(sums.shape)

    @cached_property
    def _layout(self) -> CentreLayout:
        return CentreLayout.build(self.places, self.factorization.basis, self.factorization.support_radius)


class _PeriodicLevels:
    """Each level takes what the one before leaves."""

    def __init__(self, factorization: PeriodicLevels, places: Floats) -> None:
        controls = factorization.control_points
        self._count = len(controls)
        self._levels = [
            (members, _Periodic(level, places), _Periodic(level, controls)) for members, level in factorization.levels
        ]

    def apply(self, values: Floats) -> Floats:
        left, found = values.copy(), []
        for members, there, here in self._levels:
            of_level = left[members]
            found.append(there.apply(of_level))
            left -= here.apply(of_level)
        return np.asarray(sum(found))

    def transpose(self, weights: Floats) -> Floats:
        left = np.zeros((self._count, weights.shape[1]))  # what the residual before a level counts
        for members, there, here in reversed(self._levels):
            left[members] += there.transpose(weights) - here.transpose(left)
        return left


@dataclass(frozen=True, eq=False)
class _TwoScales:
    """A coarse field, and compact levels for what it leaves."""

    factorization: TwoScaleFactorization
    places: Floats
    factors: FactorSource
    left_out: Integers

    def apply(self, values: Floats) -> Floats:
        made = self.factorization
        mean = made.averaged(np.ascontiguousarray(values))
        coarse = made.coarse.solve(mean[made.plan.coarse])
        field = coarse if made.grid is None else made.grid.spline(on_grid(coarse, made.grid))
        alone = TwoScaleInterpolant(field, (), made.basis, 0)
        left = mean[made.plan.distinct] - evaluation.displacement(alone, self._distinct)
        out = evaluation.displacement(alone, self.places)
        for system, there, here in self._levels:
            weights = _solved(system, left[system.level.members])
            there.add(weights, out)
            if here is not None:
                left -= _applied(here, weights, len(left))
        return out

    def transpose(self, weights: Floats) -> Floats:
        made = self.factorization
        left = np.zeros((len(self._distinct), weights.shape[1]))  # what the residual before a level counts
        for system, there, here in reversed(self._levels):
            centres = len(system.points)
            of_level = _transposed(there, weights, centres)
            if here is not None:
                of_level -= _transposed(here, left, centres)
            left[system.level.members] += _solved(system, of_level)
        mean = np.zeros((len(made.control_points), weights.shape[1]))
        mean[made.plan.distinct] = left
        of_coarse = self._coarse_transposed(weights, -left)
        mean[made.plan.coarse] += made.coarse.solve(of_coarse).weights  # of a compact basis: a symmetric matrix
        return made.averaged(mean)  # a symmetric map

    def _coarse_transposed(self, weights: Floats, of_controls: Floats) -> Floats:
        """(m, k) what the coarse field's weights count for those of its values at the places and control points."""
        made = self.factorization
        if made.grid is None:
            here, there = self._coarse_sums
            return here._sums(weights) + there._sums(of_controls)
        counted = made.grid.spline_transposed((self.places, weights), (self._distinct, of_controls))
        coarse = made.weightless.coarse
        assert isinstance(coarse, Interpolant)
        return on_grid_transposed(coarse, made.grid, counted)

    @cached_property
    def _coarse_sums(self) -> tuple[_OneScale, _OneScale]:
        coarse = self.factorization.coarse
        return _OneScale(coarse, self.places), _OneScale(coarse, self._distinct)

    @cached_property
    def _distinct(self) -> Floats:
        return self.factorization.control_points.take(self.factorization.plan.distinct, axis=0)

    @cached_property
    def _levels(self) -> list[tuple[CompactSystem, NearOperator, NearOperator | None]]:
        """Each level with its operators at the places and, if another level takes what it leaves, at control points."""
        made, nowhere = self.factorization, np.empty(0, dtype=np.int64)
        above = replace(made.weightless, levels=made.weightless.levels[:-1])
        there = prepared_for(made.weightless, self.places, self.factors, unasked=self.left_out)
        here = prepared_for(above, self._distinct, self.factors, unasked=nowhere)
        of_controls = () if here is None else here.operators
        return [*zip_longest(made.systems, () if there is None else there.operators, of_controls)]


def _applied(operator: NearOperator, weights: Floats, n: int) -> Floats:
    out = np.zeros((n, weights.shape[1]))
    operator.add(weights, out)
    return out


def _transposed(operator: NearOperator, weights: Floats, centres: int) -> Floats:
    """(nc, k) the transpose of an operator times (n, k) weights."""
    return np.asarray(operator.matrix.matrix(centres).T @ weights[operator.rows])


def _solved(system: CompactSystem, right: Floats) -> Floats:
    scale = float(np.abs(right).max(initial=0.0))
    return system.weights(np.ascontiguousarray(right), scale, _TOLERANCE)[0]
