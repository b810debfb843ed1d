"""Interpolation of boundary displacements by radial basis functions (thesis §2.1), with separate set-up and solve.

:func:`factorize` prepares the matrix of thesis (2.4) for one set of control points; its :class:`Factorization` gives an
:class:`Interpolant` for each set of values, which satisfies (2.2). Coupling iterations of one time step share the
factorization.

References
----------
A. de Boer, M. S. van der Schoot, H. Bijl, Computers & Structures 85 (2007) 784–795.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.control_points import checked_control_points
from mesh_motion_numerics.interpolation.factorizations import LinearSolver
from mesh_motion_numerics.interpolation.factorizations.choice import choose_solver, dense_solver
from mesh_motion_numerics.interpolation.factorizations.conditional import NullSpaceCholesky
from mesh_motion_numerics.interpolation.kernels import DEFAULT_BASIS, Basis, basis_named, checked_radius
from mesh_motion_numerics.interpolation.polynomial import LinearBasis, Polynomial

if TYPE_CHECKING:
    from mesh_motion_numerics.interpolation.two_scale.interpolant import AnyInterpolant


@dataclass(frozen=True, eq=False)
class Interpolant:
    """``s(x) = Σ_j γ_j φ(|x − x_j|/R) + p(x)``, thesis (2.1), for k components."""

    control_points: Floats  # (nc, d), mesh length unit
    weights: Floats  # (nc, k). γ
    basis: Basis
    support_radius: float  # mesh length unit
    layout: CentreLayout  # the control points laid out for evaluation
    polynomial: Polynomial | None = None

    @property
    def components(self) -> int:
        """k."""
        return int(self.weights.shape[1])


class Factorization(Protocol):
    """A prepared interpolation matrix."""

    @property
    def control_points(self) -> Floats:
        """(nc, d) array."""
        ...

    def solve(self, values: Floats) -> AnyInterpolant:
        """Return the interpolant of (nc, k) values at the control points."""
        ...


def factorize(
    control_points: ArrayLike,
    *,
    basis: str = DEFAULT_BASIS,
    support_radius: float | None,
    solver: str = "auto",
    spacing: Floats | None = None,
    smoothing: Floats | None = None,
) -> AllCentreFactorization:
    """Prepare the interpolation from control points, with the linear polynomial (thesis §2.1.2) if the basis needs it.

    Raises InvalidInput on two points that coincide, points that do not determine the polynomial, an unusable basis or
    radius, or a solver that does not fit the basis. Raises QualityRefused if the matrix is singular to working
    precision. Raises ResourceExhausted if its factors would take too much memory (:mod:`.factorizations.memory_bound`).

    Parameters
    ----------
    control_points : (nc, d) array, mesh length unit
        Distinct points, d = 1, 2 or 3.
    basis : str
        A name in :data:`~mesh_motion_numerics.interpolation.kernels.BASES`.
    support_radius : float, mesh length unit
        R; None only if the interpolant does not depend on it.
    solver : {"auto", "dense", "sparse", "iterative"}
        Solver for a positive definite basis; "auto" chooses by the number of points and the fraction of nonzero entries
        (:func:`~mesh_motion_numerics.interpolation.factorizations.choice.choose_solver`).
    spacing : (nc,) array, mesh length unit, optional
        Distance of each point to the nearest other one, if it is known.
    smoothing : (nc,) array, optional
        λ: s minimises |s|² + Σ (s(x_j) − u_j)² / λ_j in the norm of the basis, which must be positive definite; by
        default it interpolates. The solver is then "dense".
    """
    row = basis_named(basis)
    radius = checked_radius(support_radius, row)
    points = checked_control_points(control_points, spacing)
    layout = CentreLayout.build(points, row, radius)
    if row.needs_polynomial:
        linear = LinearBasis.around(points)
        return AllCentreFactorization(points, row, radius, layout, NullSpaceCholesky(points, row, radius, linear))
    if smoothing is not None:
        system: LinearSolver = dense_solver(points, row, radius, smoothing)
    else:
        system = choose_solver(solver, points, layout, row, radius)
    return AllCentreFactorization(points, row, radius, layout, system)


@dataclass(frozen=True, eq=False)
class AllCentreFactorization:
    """A prepared matrix with the points and names from which it was made."""

    control_points: Floats
    basis: Basis
    support_radius: float
    layout: CentreLayout
    system: LinearSolver | NullSpaceCholesky

    @property
    def solver(self) -> str:
        """Name of the solver in use: "dense", "sparse" or "iterative"."""
        return self.system.name

    def solve(self, values: Floats) -> Interpolant:
        values, polynomial = np.asarray(values, dtype=np.float64), None
        if isinstance(self.system, NullSpaceCholesky):
            weights, polynomial = self.system.solve(values)
        else:
            weights = self.system.solve(values)
        return Interpolant(self.control_points, weights, self.basis, self.support_radius, self.layout, polynomial)
