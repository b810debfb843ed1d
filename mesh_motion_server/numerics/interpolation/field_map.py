"""The coefficients of an interpolant as a linear map of the values at its control points, and the transpose.

Where somebody else evaluates the interpolant, what the values there count for the coefficients is all that comes back.
In two scales the compact levels are solved as accurately as in :mod:`.interpolation_map`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.arrays import Floats
from mesh_motion_server.numerics.interpolation import evaluation
from mesh_motion_server.numerics.interpolation.centres import CentreLayout
from mesh_motion_server.numerics.interpolation.factorizations.conditional import NullSpaceCholesky
from mesh_motion_server.numerics.interpolation.interpolant import AllCentreFactorization, Factorization, Interpolant
from mesh_motion_server.numerics.interpolation.interpolation_map import _solved, _transposed
from mesh_motion_server.numerics.interpolation.two_scale.factorization import TwoScaleFactorization
from mesh_motion_server.numerics.interpolation.two_scale.grid_sums import on_grid, on_grid_transposed
from mesh_motion_server.numerics.interpolation.two_scale.interpolant import AnyInterpolant, TwoScaleInterpolant
from mesh_motion_server.numerics.interpolation.two_scale.near_operator import NearOperator

__all__ = ["FieldMap"]


@dataclass(frozen=True, eq=False)
class FieldMap:
    """That of a factorization without reduction and without periods."""

    factorization: Factorization

    def interpolant(self, values: Floats) -> AnyInterpolant:
        """Of (nc, k) values at the control points."""
        made = self.factorization
        if not isinstance(made, TwoScaleFactorization):
            return made.solve(values)
        mean = made.averaged(np.ascontiguousarray(values))
        field = made.coarse.solve(mean[made.plan.coarse])
        coarse = field if made.grid is None else made.grid.spline(on_grid(field, made.grid))
        left = mean[made.plan.distinct]
        left -= evaluation.displacement(TwoScaleInterpolant(coarse, (), made.basis, 0), self._distinct)
        levels = []
        for system, here in zip(made.systems, self._here, strict=True):
            weights = _solved(system, left[system.level.members])
            levels.append(system.interpolant(weights))
            here.add(-weights, left)
        return TwoScaleInterpolant(coarse, tuple(levels), made.basis, 0)

    def transpose(self, coarse: Floats, levels: list[Floats]) -> Floats:
        """(nc, k) what the values count for weights of the coefficients.

        Parameters
        ----------
        coarse : (r, k) array
            Of the spline, or of the first sum, its polynomial's behind.
        levels : list of (n, k) arrays
            Of the compact levels.
        """
        made = self.factorization
        if isinstance(made, AllCentreFactorization):
            count = len(made.control_points)
            if isinstance(made.system, NullSpaceCholesky):
                return made.system.solve_bordered(coarse[:count], coarse[count:])
            return made.system.solve(coarse)
        if not isinstance(made, TwoScaleFactorization):
            raise InvalidInput(f"an interpolation of the kind {made.solver!r} has no derivative")
        left = np.zeros((len(self._distinct), coarse.shape[1]))  # what the residual before a level counts
        for system, here, rows in reversed([*zip(made.systems, self._here, levels, strict=True)]):
            of_level = rows - _transposed(here, left, len(system.points))
            left[system.level.members] += _solved(system, of_level)
        mean = np.zeros((len(made.control_points), coarse.shape[1]))
        mean[made.plan.distinct] = left
        field = made.coarse
        if made.grid is None:
            layout = CentreLayout.build(self._distinct, field.basis, field.support_radius)
            turned = Interpolant(self._distinct, -left, field.basis, field.support_radius, layout)
            of_coarse = coarse + evaluation.displacement(turned, field.control_points)
        else:
            nothing = np.empty((len(field.control_points), 0))
            sums = Interpolant(field.control_points, nothing, field.basis, field.support_radius, field.layout)
            counted = made.grid.spline_transposed((self._distinct, -left), of_coefficients=coarse)
            of_coarse = on_grid_transposed(sums, made.grid, counted)
        mean[made.plan.coarse] += field.solve(of_coarse).weights  # of a compact basis: a symmetric matrix
        return made.averaged(mean)  # a symmetric map

    @cached_property
    def _distinct(self) -> Floats:
        made = self.factorization
        assert isinstance(made, TwoScaleFactorization)
        return made.control_points.take(made.plan.distinct, axis=0)

    @cached_property
    def _here(self) -> list[NearOperator]:
        """The levels at the distinct control points."""
        made = self.factorization
        assert isinstance(made, TwoScaleFactorization)
        weightless = [system.interpolant(np.empty((len(system.points), 0))) for system in made.systems]
        return [NearOperator.build(level, self._distinct) for level in weightless]
