"""Imposed-gradient correction in one dimension (thesis chapter 4).

An enrichment point x_c adds one function H(x − x_c, R_l) and one condition: there the displacement has the slope J of a
straight line between the two boundary nodes that bracket it. With the boundary conditions this gives one linear system
for the weights γ and the enrichment's coefficients β, thesis (4.2), (4.3), (4.9)::

    [ φ_bb    H_bc  ] [ γ ]   [ d_b ]
    [ ∇φ_cb   ∇H_cc ] [ β ] = [  J  ]

and the displacement anywhere is ``[φ  H] [γ; β]``, thesis (4.4), (4.10).
"""

from dataclasses import dataclass

import numpy as np
from mesh_motion_protocol.errors import InvalidInput, QualityRefused

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.blas import one_blas_thread
from mesh_motion_numerics.correction.enrichment import functions
from mesh_motion_numerics.interpolation.kernels import DEFAULT_BASIS, Basis, basis_named, checked_radius, slopes, values


@dataclass(frozen=True)
class ImposedGradient:
    """Settings of the imposed-gradient correction."""

    support_radius: float  # mesh length unit. R of the basis
    enrichment_radius: float  # mesh length unit. R_l
    basis: str = DEFAULT_BASIS
    function: str = "H1"  # {"H1", "H2", "H3"}


@dataclass(frozen=True, eq=False)
class EnrichedInterpolant:
    """The solution of thesis (4.9)."""

    #: boundary, enrichment_points: (nb,), (nc,), mesh length unit
    boundary: Floats
    enrichment_points: Floats
    #: weights, coefficients: (nb,), (nc,). γ and β
    weights: Floats
    coefficients: Floats
    settings: ImposedGradient

    def displacement(self, x: Floats) -> Floats:
        """(n,) displacement at (n,) places, thesis (4.10)."""
        return self._sum(*_values(x, self.boundary, self.enrichment_points, self.settings))

    def gradient(self, x: Floats) -> Floats:
        """(n,) derivative of the displacement at (n,) places."""
        return self._sum(*_derivatives(x, self.boundary, self.enrichment_points, self.settings))

    def _sum(self, phi: Floats, h: Floats) -> Floats:
        """(n,) combination of (n, nb) and (n, nc) functions."""
        total: Floats = np.sum(phi * self.weights, axis=1) + np.sum(h * self.coefficients, axis=1)
        return total


def bracketing_slopes(boundary: Floats, displacement: Floats, enrichment_points: Floats) -> Floats:
    """J of each enrichment point, thesis (4.1): ``(D_a − D_b) / (x_a − x_b)`` over the boundary nodes that bracket it.

    Raises InvalidInput if an enrichment point does not lie between two boundary nodes.

    Parameters
    ----------
    boundary, displacement : (nb,) arrays, mesh length unit
        All boundary nodes with a prescribed displacement, fixed nodes included; any order.
    enrichment_points : (nc,) array, mesh length unit
    """
    order = np.argsort(boundary, kind="stable")
    x, d = boundary[order], displacement[order]
    right = np.searchsorted(x, enrichment_points)
    outside = np.flatnonzero((right == 0) | (right == len(x)))
    if outside.size:
        raise InvalidInput(
            f"enrichment point {outside[0]} at {enrichment_points[outside[0]]:g} does not lie between two boundary "
            f"nodes ({x[0]:g} … {x[-1]:g})",
            hint="the imposed gradient is the slope between the boundary nodes on either side",
        )
    slope: Floats = (d[right] - d[right - 1]) / (x[right] - x[right - 1])
    return slope


def solve_imposed_gradient(
    boundary: Floats,
    displacement: Floats,
    enrichment_points: Floats,
    settings: ImposedGradient,
    *,
    slopes_at_points: Floats | None = None,
) -> EnrichedInterpolant:
    """Solve thesis (4.9).

    Raises InvalidInput on an unusable basis, function or radius, or a point that does not lie between two boundary
    nodes. Raises QualityRefused if the system is singular: two enrichment points coincide, or one has no influence.

    Parameters
    ----------
    boundary, displacement : (nb,) arrays, mesh length unit
        Distinct nodes.
    enrichment_points : (nc,) array, mesh length unit
        Distinct.
    slopes_at_points : (nc,) array, optional
        J; by default :func:`bracketing_slopes`.
    """
    if slopes_at_points is None:
        slopes_at_points = bracketing_slopes(boundary, displacement, enrichment_points)
    phi_b, h_b = _values(boundary, boundary, enrichment_points, settings)
    phi_c, h_c = _derivatives(enrichment_points, boundary, enrichment_points, settings)
    matrix = np.block([[phi_b, h_b], [phi_c, h_c]])
    with one_blas_thread():
        try:
            solution = np.linalg.solve(matrix, np.concatenate([displacement, slopes_at_points]))
        except np.linalg.LinAlgError:
            raise QualityRefused(
                "the system of boundary displacements and imposed gradients is singular",
                code="FAILED_PRECONDITION",
                hint="separate the enrichment points from each other",
            ) from None
    nb = len(boundary)
    return EnrichedInterpolant(boundary, enrichment_points, solution[:nb], solution[nb:], settings)


def enriched_displacement(
    nodes: Floats, boundary: Floats, displacement: Floats, enrichment_points: Floats, settings: ImposedGradient
) -> Floats:
    """The corrected displacement of every node.

    Raises InvalidInput or QualityRefused as :func:`solve_imposed_gradient`.

    Parameters
    ----------
    nodes : (n, 1) array, mesh length unit
    boundary, displacement : (nb, 1) arrays, mesh length unit
    enrichment_points : (nc, 1) array, mesh length unit

    Returns
    -------
    (n, 1) array
    """
    interpolant = solve_imposed_gradient(boundary[:, 0], displacement[:, 0], enrichment_points[:, 0], settings)
    return interpolant.displacement(nodes[:, 0])[:, None]


def _basis(settings: ImposedGradient) -> tuple[Basis, float]:
    basis = basis_named(settings.basis, gradient=True)
    if basis.needs_polynomial:
        raise InvalidInput(
            f"the imposed gradient has no polynomial term, which the basis {basis.name!r} needs",
            hint=f"take {DEFAULT_BASIS!r}",
        )
    return basis, checked_radius(settings.support_radius, basis)


def _values(x: Floats, boundary: Floats, points: Floats, settings: ImposedGradient) -> tuple[Floats, Floats]:
    """(n, nb) φ and (n, nc) H."""
    basis, radius = _basis(settings)
    phi = values(basis, np.abs(x[:, None] - boundary) / radius)
    h = [functions.values(settings.function, x[:, None], c, settings.enrichment_radius)[:, 0] for c in points]
    return phi, np.array(h).reshape(len(points), len(x)).T


def _derivatives(x: Floats, boundary: Floats, points: Floats, settings: ImposedGradient) -> tuple[Floats, Floats]:
    """(n, nb) ∂φ/∂x and (n, nc) ∂H/∂x."""
    basis, radius = _basis(settings)
    rho = x[:, None] - boundary
    phi = slopes(basis, np.abs(rho) / radius) * rho / radius**2
    h = [functions.gradients(settings.function, x[:, None], c, settings.enrichment_radius)[:, 0, 0] for c in points]
    return phi, np.array(h).reshape(len(points), len(x)).T
