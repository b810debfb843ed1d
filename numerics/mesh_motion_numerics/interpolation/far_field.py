"""Interpolation around a body in a far field: its mean displacement reaches far, the rest of its displacement does not.

A support radius that is large against the body carries a shift of the body gently into the far field. But a rotation
grows with the distance: interpolated with the same radius, nodes some body lengths away move 4 to 11 times as fast as
the body. So both parts have their own radius::

    S(x) = t φ(|x − c| / R_t) + s(x)

t is the mean displacement of the moving control points, c the middle of their box, and s interpolates what is left at
all control points. The sum is exact at all of them, and linear in their values (:mod:`.support_radius` chooses radii).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.interpolant import Factorization, Interpolant
from mesh_motion_numerics.interpolation.kernels import DEFAULT_BASIS, basis_named
from mesh_motion_numerics.interpolation.two_scale.interpolant import AnyInterpolant, TwoScaleInterpolant
from mesh_motion_numerics.mesh.points import bounding_box


@dataclass(frozen=True, eq=False)
class FarFieldFactorization:
    """A :class:`.Factorization` that separates the mean displacement of the moving control points."""

    near: Factorization  # That of s
    moving: Integers  # (m,). Rows of the moving control points
    mean_radius: float  # mesh length unit. R_t

    @property
    def control_points(self) -> Floats:
        return self.near.control_points

    def solve(self, values: Floats) -> TwoScaleInterpolant:
        """Return the interpolant of (nc, k) values at the control points."""
        mean, left = self.separated(values)
        return self.joined(mean, self.near.solve(left))

    def separated(self, values: Floats) -> tuple[Floats, Floats]:
        """The mean (1, k) of the moving control points' values, and the remainder of all values (nc, k)."""
        mean = values[self.moving].mean(axis=0, keepdims=True)
        return mean, values - self._shares * mean

    def separated_transposed(self, mean: Floats, left: Floats) -> Floats:
        """The transpose of :meth:`separated`: (nc, k) derivatives by the values."""
        values = left.copy()
        values[self.moving] += (mean - self._shares.T @ left) / len(self.moving)
        return values

    def joined(self, mean: Floats, near: AnyInterpolant) -> TwoScaleInterpolant:
        """The interpolant of a mean (1, k) and of the remainder."""
        whole = TwoScaleInterpolant(near, ()) if isinstance(near, Interpolant) else near
        return TwoScaleInterpolant(whole.coarse, (self.far(mean), *whole.levels))

    def far(self, mean: Floats) -> Interpolant:
        """t φ(|x − c| / R_t) for t = ``mean`` (1, k)."""
        return Interpolant(self._centre, mean, basis_named(DEFAULT_BASIS), self.mean_radius, self._layout)

    @cached_property
    def _centre(self) -> Floats:
        """(1, d) c."""
        return np.asarray(bounding_box(self.control_points[self.moving]).mean(axis=0, keepdims=True))

    @cached_property
    def _layout(self) -> CentreLayout:
        return CentreLayout.build(self._centre, basis_named(DEFAULT_BASIS), self.mean_radius)

    @cached_property
    def _shares(self) -> Floats:
        """(nc, 1) φ(|x − c| / R_t) at the control points."""
        return evaluation.displacement(self.far(np.ones((1, 1))), self.control_points)
