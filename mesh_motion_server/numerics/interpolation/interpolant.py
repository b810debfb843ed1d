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
from numpy.typing import ArrayLike, NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.interpolation.centres import CentreLayout
from mesh_motion_server.numerics.interpolation.control_points import checked_control_points
from mesh_motion_server.numerics.interpolation.factorizations import System
from mesh_motion_server.numerics.interpolation.factorizations.bordered import BorderedSystem
from mesh_motion_server.numerics.interpolation.factorizations.choice import SOLVERS, choose_solver
from mesh_motion_server.numerics.interpolation.factorizations.conditional import NullSpaceCholesky
from mesh_motion_server.numerics.interpolation.kernels import DEFAULT_BASIS, Basis, basis_named, checked_radius
from mesh_motion_server.numerics.interpolation.polynomial import LinearBasis, Polynomial

if TYPE_CHECKING:
    from mesh_motion_server.numerics.interpolation.two_scale.interpolant import AnyInterpolant

__all__ = ["POLYNOMIALS", "AllCentreFactorization", "Factorization", "Interpolant", "chosen_polynomial", "factorize"]

Array = NDArray[np.float64]

#: "auto" adds the linear polynomial if the basis requires it.
POLYNOMIALS = ("auto", "none", "linear")


@dataclass(frozen=True, eq=False)
class Interpolant:
    """``s(x) = Σ_j γ_j φ(|x − x_j|/R) + p(x)``, thesis (2.1), for k components.

    Attributes
    ----------
    control_points : (nc, d) array, mesh length unit
    weights : (nc, k) array
        γ.
    basis : Basis
    support_radius : float, mesh length unit
    layout : CentreLayout
        The control points laid out for evaluation.
    polynomial : Polynomial or None
    largest : float, unit of the values
        Largest value, as a Euclidean norm, to which a tolerance of its evaluation refers; 0: only exact sums.
    """

    control_points: Array
    weights: Array
    basis: Basis
    support_radius: float
    layout: CentreLayout
    polynomial: Polynomial | None = None
    largest: float = 0.0

    @property
    def dimension(self) -> int:
        """Space dimension d."""
        return int(self.control_points.shape[1])

    @property
    def components(self) -> int:
        """k."""
        return int(self.weights.shape[1])


class Factorization(Protocol):
    """A prepared interpolation matrix."""

    @property
    def control_points(self) -> Array:
        """(nc, d) array."""
        ...

    @property
    def basis(self) -> Basis: ...

    @property
    def support_radius(self) -> float: ...

    @property
    def solver(self) -> str:
        """Name of the solver in use: "dense", "sparse", "iterative" or "two-scale"."""
        ...

    @property
    def nbytes(self) -> int:
        """Memory it holds."""
        ...

    def solve(self, values: Array) -> AnyInterpolant:
        """Interpolant of (nc, k) values at the control points."""
        ...


def factorize(
    control_points: ArrayLike,
    *,
    basis: str = DEFAULT_BASIS,
    support_radius: float | None,
    solver: str = "auto",
    polynomial: str = "auto",
) -> AllCentreFactorization:
    """Prepare the interpolation from control points.

    Parameters
    ----------
    control_points : (nc, d) array, mesh length unit
        Distinct points, d = 1, 2 or 3.
    basis : str
        A name in :data:`~mesh_motion_server.numerics.interpolation.kernels.BASES`.
    support_radius : float, mesh length unit
        R; None only if the interpolant does not depend on it.
    solver : {"auto", "dense", "sparse", "iterative"}
        "auto" chooses by the number of points and the fraction of nonzero entries
        (:func:`~mesh_motion_server.numerics.interpolation.factorizations.choice.choose_solver`).
    polynomial : {"auto", "none", "linear"}

    Raises
    ------
    InvalidInput
        On unusable points, two that coincide, an unknown or unusable name, or names that do not fit together.
    NumericalError
        If the matrix is singular to working precision.
    ResourceError
        If its factors would take too much memory (:mod:`.factorizations.memory_bound`).
    """
    row = basis_named(basis)
    radius = checked_radius(support_radius, row)
    points = checked_control_points(control_points)
    linear = chosen_polynomial(polynomial, row, points)
    if solver not in SOLVERS:
        raise InvalidInput(f"unknown solver {solver!r}", hint=f"known are {', '.join(SOLVERS)}")
    layout = CentreLayout.build(points, row, radius)
    system = _system(solver, points, layout, row, radius, None if linear is None else linear.matrix(points))
    return AllCentreFactorization(points, row, radius, layout, system, linear)


def _system(
    solver: str, points: Array, layout: CentreLayout, basis: Basis, radius: float, polynomial_matrix: Array | None
) -> System:
    """The prepared matrix of thesis (2.4)."""
    if basis.needs_polynomial and polynomial_matrix is not None:
        if solver not in {"auto", "dense"}:
            raise InvalidInput(
                f"the basis {basis.name!r} has only a dense solver, not {solver!r}", hint="solver = 'auto'"
            )
        return NullSpaceCholesky(points, basis, radius, polynomial_matrix)
    return BorderedSystem(choose_solver(solver, points, layout, basis, radius), polynomial_matrix)


def chosen_polynomial(choice: str, basis: Basis, points: Array) -> LinearBasis | None:
    """The linear polynomial (thesis §2.1.2) of (nc, d) control points, if it is chosen or needed.

    Raises
    ------
    InvalidInput
        If the choice is unknown, "none" although the basis needs one, or the points do not determine it.
    """
    if choice not in POLYNOMIALS:
        raise InvalidInput(f"unknown polynomial {choice!r}", hint=f"known are {', '.join(POLYNOMIALS)}")
    if choice == "none" and basis.needs_polynomial:
        raise InvalidInput(
            f"the basis {basis.name!r} is only conditionally definite (order {basis.order}): it needs a polynomial",
            hint="polynomial = 'linear' (or 'auto'), or another basis",
        )
    return LinearBasis.around(points) if choice == "linear" or basis.needs_polynomial else None


@dataclass(frozen=True, eq=False)
class AllCentreFactorization:
    """A system with the points and names from which it was made."""

    control_points: Array
    basis: Basis
    support_radius: float
    layout: CentreLayout
    system: System
    linear: LinearBasis | None

    @property
    def solver(self) -> str:
        return self.system.name

    @property
    def nbytes(self) -> int:
        return self.system.nbytes + self.layout.coordinates.nbytes + self.control_points.nbytes

    def solve(self, values: Array) -> Interpolant:
        values = np.asarray(values, dtype=np.float64)
        if values.ndim != 2 or len(values) != len(self.control_points):
            raise InvalidInput(
                f"expected values of shape ({len(self.control_points)}, k), a row a control point, got {values.shape}",
                code="INVALID_ARGUMENT.SHAPE",
            )
        weights, beta = self.system.solve(values)
        polynomial = None if self.linear is None or beta is None else Polynomial(self.linear, beta)
        return Interpolant(self.control_points, weights, self.basis, self.support_radius, self.layout, polynomial)
