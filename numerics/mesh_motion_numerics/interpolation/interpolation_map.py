"""An interpolation as a linear map of the values at its control points, and the transpose of that map.

The results are the values at given places, or the coefficients if another program evaluates the interpolant. The map is
the same as in a motion, with the same coarse points, levels, grid and polynomials. The transpose runs through the same
operations backwards, so ``⟨w, A v⟩ = ⟨Aᵀ w, v⟩`` holds to rounding, as an adjoint requires. In two scales the compact
levels are solved exactly, but a motion leaves a residual to the next level.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import zip_longest
from typing import Protocol

import numpy as np
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.evaluation import NearOperator
from mesh_motion_numerics.interpolation.factor_source import FactorSource, MakeEachTime, operators_of
from mesh_motion_numerics.interpolation.factorizations.conditional import NullSpaceCholesky
from mesh_motion_numerics.interpolation.far_field import FarFieldFactorization
from mesh_motion_numerics.interpolation.interpolant import AllCentreFactorization, Factorization, Interpolant
from mesh_motion_numerics.interpolation.periodic_interpolant import PeriodicFactorization, PeriodicLevels
from mesh_motion_numerics.interpolation.two_scale.compact_levels import CompactSystem
from mesh_motion_numerics.interpolation.two_scale.factorization import TwoScaleFactorization
from mesh_motion_numerics.interpolation.two_scale.grid_sums import on_grid, on_grid_transposed
from mesh_motion_numerics.interpolation.two_scale.interpolant import AnyInterpolant, TwoScaleInterpolant
from mesh_motion_numerics.interpolation.two_scale.nested_grid import NestedSpline


class InterpolationMap(Protocol):
    """(nc, k) values at control points → (n, k) values at places; made by :func:`interpolation_map`."""

    def apply(self, values: Floats) -> Floats:
        """(n, k) values at the places."""
        ...

    def transpose(self, weights: Floats) -> Floats:
        """(nc, k) derivatives by the values at the control points, for (n, k) weights of the values at the places."""
        ...


def interpolation_map(
    factorization: Factorization,
    places: Floats,
    factors: FactorSource | None = None,
    *,
    left_out: Integers | None = None,
) -> InterpolationMap:
    """Return the map of a factorization to (n, d) places.

    Raises InvalidInput if the control points are reduced: that map has no transpose.

    Parameters
    ----------
    factors : FactorSource, optional
        Source of the compact levels' operators that a motion has made.
    left_out : (r,) int64 array, optional
        Places whose values are not used; their weights are zero.
    """
    if isinstance(factorization, AllCentreFactorization | PeriodicFactorization):
        return _AllCentres(factorization, places)
    factors = MakeEachTime() if factors is None else factors  # an empty cache counts as false
    left_out = np.empty(0, dtype=np.int64) if left_out is None else left_out
    if isinstance(factorization, TwoScaleFactorization):
        return _TwoScales(_Levels(factorization, factors), places, left_out)
    if isinstance(factorization, FarFieldFactorization):
        near = interpolation_map(factorization.near, places, factors, left_out=left_out)
        return _FarField(factorization, near, places, factors, left_out)
    if isinstance(factorization, PeriodicLevels):
        return _PeriodicLevels(factorization, places)
    raise InvalidInput("an interpolation from reduced control points has no derivative")


@dataclass(frozen=True, eq=False)
class FieldMap:
    """The coefficients of an interpolant, by a factorization without reduction.

    Another program evaluates the interpolant, and returns the derivatives by the coefficients.
    """

    factorization: Factorization
    #: Source of the compact levels' operators that a motion has made.
    factors: FactorSource = field(default_factory=MakeEachTime)

    def interpolant(self, values: Floats) -> AnyInterpolant:
        """Return the interpolant of (nc, k) values at the control points."""
        made = self.factorization
        if isinstance(made, FarFieldFactorization):
            mean, left = made.separated(values)
            return made.joined(mean, FieldMap(made.near, self.factors).interpolant(left))
        if not isinstance(made, TwoScaleFactorization):
            return made.solve(values)
        coarse, weights = _Levels(made, self.factors).solve(values)
        levels = tuple(system.interpolant(rows) for system, rows in zip(made.systems, weights, strict=True))
        return TwoScaleInterpolant(coarse, levels)

    def transpose(self, coarse: Floats, levels: Sequence[Floats] = ()) -> Floats:
        """The transpose: (nc, k) derivatives by the values, for weights of the coefficients.

        Parameters
        ----------
        coarse : (r, k) array
            Weights of the spline's coefficients, or of the first sum's, with its polynomial's at the end.
        levels : sequence of (n, k) arrays
            Weights of the compact levels' coefficients.
        """
        made = self.factorization
        if isinstance(made, FarFieldFactorization):
            return made.separated_transposed(levels[0], FieldMap(made.near, self.factors).transpose(coarse, levels[1:]))
        if isinstance(made, AllCentreFactorization):
            if isinstance(made.system, NullSpaceCholesky):
                return made.system.solve_bordered(*np.split(coarse, [len(made.control_points)]))
            return made.system.solve(coarse)
        if isinstance(made, PeriodicFactorization):
            return _of_images(made, coarse)
        if isinstance(made, PeriodicLevels):
            return _PeriodicLevels(made).transpose_weights([coarse, *levels])
        if not isinstance(made, TwoScaleFactorization):
            raise InvalidInput("an interpolation from reduced control points has no derivative")
        own = _Levels(made, self.factors)

        def of_coarse(weights: Floats) -> Floats:
            if made.grid is None:
                return coarse + own.coarse_sums(own.distinct).transpose_sums(weights)
            return own.of_spline((own.distinct, weights), of_coefficients=coarse)

        return own.transpose(levels, of_coarse, coarse.shape[1])


@dataclass(frozen=True, eq=False)
class _AllCentres:
    """The map when all control points, or all their periodic images, are centres."""

    factorization: AllCentreFactorization | PeriodicFactorization
    places: Floats

    def apply(self, values: Floats) -> Floats:
        return evaluation.displacement(self.factorization.solve(values), self.places)

    def transpose(self, weights: Floats) -> Floats:
        made, rows = self.factorization, self.transpose_sums(weights)
        if isinstance(made.system, NullSpaceCholesky):
            rows = np.concatenate([rows, made.system.linear.matrix(self.places).T @ weights])
        return FieldMap(made).transpose(rows)

    def transpose_sums(self, weights: Floats) -> Floats:
        """(c, k) Φᵀ w: φ is symmetric, so the places are the centres of a sum at the centres (c, d)."""
        made = self.factorization
        turned = Interpolant(self.places, weights, made.basis, made.support_radius, self._layout)
        centres = made.images.places if isinstance(made, PeriodicFactorization) else made.control_points
        return evaluation.displacement(turned, centres)

    @cached_property
    def _layout(self) -> CentreLayout:
        return CentreLayout.build(self.places, self.factorization.basis, self.factorization.support_radius)


@dataclass(frozen=True, eq=False)
class _FarField:
    """The map when the mean of the moving control points' values is carried apart."""

    factorization: FarFieldFactorization
    near: InterpolationMap
    places: Floats
    factors: FactorSource
    left_out: Integers

    def apply(self, values: Floats) -> Floats:
        mean, left = self.factorization.separated(values)
        out = self.near.apply(left)
        self._there.add(mean, out)
        return out

    def transpose(self, weights: Floats) -> Floats:
        mean = self._there.transpose(weights, 1)
        return self.factorization.separated_transposed(mean, self.near.transpose(weights))

    @cached_property
    def _there(self) -> NearOperator:
        """The mean's operator at the places."""
        alone = self.factorization.far(np.empty((1, 0)))
        return operators_of((alone,), self.places, self.factors, skipped=self.left_out)[0]


def _of_images(made: PeriodicFactorization, weights: Floats) -> Floats:
    """(nc, k) derivatives by the values at the control points, for weights (i, k) of the images' coefficients."""
    images, sums = made.images, np.zeros((len(made.control_points), weights.shape[1]))
    if images.rotations is None:
        np.add.at(sums, images.owners, weights)
        return made.system.solve(sums)
    np.add.at(sums, images.owners, np.einsum("iab,ia->ib", images.rotations, weights))
    return made.system.solve(sums.reshape(-1, 1)).reshape(sums.shape)


class _PeriodicLevels:
    """Periodic levels: each interpolates the residual of the one before it. Without ``places``: only coefficients."""

    def __init__(self, factorization: PeriodicLevels, places: Floats | None = None) -> None:
        controls = factorization.control_points
        self._count = len(controls)
        self._levels = [(members, level, _AllCentres(level, controls)) for members, level in factorization.levels]
        self._there = [] if places is None else [_AllCentres(level, places) for _, level in factorization.levels]

    def apply(self, values: Floats) -> Floats:
        left, found = values.copy(), []
        for (members, _, here), there in zip(self._levels, self._there, strict=True):
            of_level = left[members]
            found.append(there.apply(of_level))
            left -= here.apply(of_level)
        return np.asarray(sum(found))

    def transpose(self, weights: Floats) -> Floats:
        return self._transposed([there.transpose(weights) for there in self._there])

    def transpose_weights(self, weights: Sequence[Floats]) -> Floats:
        """The transpose: (nc, k) derivatives by the values, for weights (i, k) of each level's coefficients."""
        return self._transposed(
            [_of_images(level, rows) for (_, level, _), rows in zip(self._levels, weights, strict=True)]
        )

    def _transposed(self, of_levels: Sequence[Floats]) -> Floats:
        """The transpose of the levels: (nc, k), from the derivatives by each level's values (m, k)."""
        left = np.zeros((self._count, of_levels[0].shape[1]))  # the derivative by the residual before a level
        for (members, _, here), rows in zip(reversed(self._levels), reversed(of_levels), strict=True):
            left[members] += rows - here.transpose(left)
        return left


@dataclass(frozen=True, eq=False)
class _Levels:
    """The coefficients of a coarse field, and of compact levels for its residual."""

    made: TwoScaleFactorization
    factors: FactorSource

    def solve(self, values: Floats) -> tuple[NestedSpline | Interpolant, list[Floats]]:
        """Solve for the coarse field of (nc, k) values, and for each level's weights (n, k)."""
        made = self.made
        mean = made.averaged(np.ascontiguousarray(values))
        coarse = made.coarse.solve(mean[made.plan.coarse])
        found = coarse if made.grid is None else made.grid.spline(on_grid(coarse, made.grid))
        left, levels = mean[made.plan.distinct] - evaluation.displacement(found, self.distinct), []
        for system, here in self._systems:
            levels.append(system.exactly(left[system.level.members]))
            if here is not None:
                left -= _applied(here, levels[-1], len(left))
        return found, levels

    def transpose(self, levels: Sequence[Floats], of_coarse: Callable[[Floats], Floats], components: int) -> Floats:
        """The transpose: (nc, k) derivatives by the values, for weights (n, k) of each level's weights.

        ``of_coarse`` returns the derivatives by the coarse sum's weights (m, k), from those by its values at
        :attr:`distinct`.
        """
        made = self.made
        left = np.zeros((len(self.distinct), components))  # the derivative by the residual before a level
        for (system, here), rows in reversed([*zip(self._systems, levels, strict=True)]):
            of_level = rows if here is None else rows - here.transpose(left, len(system.points))
            left[system.level.members] += system.exactly(of_level)
        mean = np.zeros((len(made.control_points), left.shape[1]))
        mean[made.plan.distinct] = left
        mean[made.plan.coarse] += made.coarse.solve(of_coarse(-left)).weights  # a symmetric matrix
        return made.averaged(mean)  # the map is symmetric

    def of_spline(self, *weighted: tuple[Floats, Floats], of_coefficients: Floats | None = None) -> Floats:
        """(m, k) derivatives by the coarse sum's weights: see :meth:`.NestedGrid.spline_transposed`."""
        made, coarse = self.made, self.made.weightless.coarse
        assert made.grid is not None
        assert isinstance(coarse, Interpolant)
        counted = made.grid.spline_transposed(*weighted, of_coefficients=of_coefficients)
        return on_grid_transposed(coarse, made.grid, counted)

    def coarse_sums(self, places: Floats) -> _AllCentres:
        """The coarse sum at places (n, d), if it is no spline."""
        return _AllCentres(self.made.coarse, places)

    @cached_property
    def distinct(self) -> Floats:
        """(p, d) the control points, with one point for each place."""
        return self.made.control_points.take(self.made.plan.distinct, axis=0)

    @cached_property
    def _systems(self) -> list[tuple[CompactSystem, NearOperator | None]]:
        """Each level with its operator at :attr:`distinct`, if a further level interpolates its residual."""
        above, nowhere = self.made.weightless.levels[:-1], np.empty(0, dtype=np.int64)
        return [*zip_longest(self.made.systems, operators_of(above, self.distinct, self.factors, skipped=nowhere))]


@dataclass(frozen=True, eq=False)
class _TwoScales:
    """The map of a coarse field, and of compact levels for its residual."""

    levels: _Levels
    places: Floats
    left_out: Integers

    def apply(self, values: Floats) -> Floats:
        coarse, weights = self.levels.solve(values)
        out = evaluation.displacement(coarse, self.places)
        for there, rows in zip(self._there, weights, strict=True):
            there.add(rows, out)
        return out

    def transpose(self, weights: Floats) -> Floats:
        counts = [len(system.points) for system in self.levels.made.systems]
        rows = [there.transpose(weights, count) for there, count in zip(self._there, counts, strict=True)]
        return self.levels.transpose(rows, lambda left: self._of_coarse(weights, left), weights.shape[1])

    def _of_coarse(self, weights: Floats, of_controls: Floats) -> Floats:
        """(m, k) derivatives by the coarse sum's weights, from those by its values at places and control points."""
        if self.levels.made.grid is None:
            here, there = self._coarse_sums
            return here.transpose_sums(weights) + there.transpose_sums(of_controls)
        return self.levels.of_spline((self.places, weights), (self.levels.distinct, of_controls))

    @cached_property
    def _coarse_sums(self) -> tuple[_AllCentres, _AllCentres]:
        return self.levels.coarse_sums(self.places), self.levels.coarse_sums(self.levels.distinct)

    @cached_property
    def _there(self) -> tuple[NearOperator, ...]:
        """The levels' operators at the places."""
        made, factors = self.levels.made, self.levels.factors
        return operators_of(made.weightless.levels, self.places, factors, skipped=self.left_out)


def _applied(operator: NearOperator, weights: Floats, n: int) -> Floats:
    out = np.zeros((n, weights.shape[1]))
    operator.add(weights, out)
    return out
