"""An interpolant around a point: all derivatives up to the third, hence ∇S in the neighbourhood to second order.

With ``y = x − x_j``, ``ξ = |y|/R`` and ``ψ_k(ξ) = (1/ξ d/dξ)^k φ(ξ)`` the derivatives of a radial function are ::

    ∂_a φ = ψ_1 y_a / R²
    ∂_ab φ = ψ_1 δ_ab / R² + ψ_2 y_a y_b / R⁴
    ∂_abc φ = ψ_2 (δ_ab y_c + δ_ac y_b + δ_bc y_a) / R⁴ + ψ_3 y_a y_b y_c / R⁶

Wendland's functions are polynomials ``φ = Σ_n a_n ξⁿ`` without a linear term (C2, C4, C6), so that every ψ_k is a
polynomial too, up to a power: ``ψ_k = Σ_n a_n n (n − 2) … (n − 2k + 2) ξ^(n − 2k)``. Only they are expanded here.

A group's polynomial is kept as the coefficients of the monomials of ``x − centre`` of degree 1 to 3 (the value at the
centre moves all nodes of a cell equally and has no influence on its quality).
"""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations_with_replacement
from math import factorial, prod

import mesh_motion_kernels as kernels
import numpy as np
from mesh_motion_numerics.interpolation.interpolant import Interpolant
from mesh_motion_numerics.mesh.points import padded
from numpy.typing import NDArray

__all__ = ["EXPANDABLE", "expand", "monomials", "radial_derivatives", "third_order_norms"]

Floats = NDArray[np.float64]

#: (1 − ξ)^p q(ξ): p and the coefficients of q, lowest first, from thesis Table 2.1. Exact, so that no odd power below
#: the first true one leaves a rounding error that ξ^(n − 2k) would blow up.
EXPANDABLE: dict[str, tuple[int, tuple[Fraction | int, ...]]] = {
    "wendland-c2": (4, (1, 4)),
    "wendland-c4": (6, (1, 6, Fraction(35, 3))),
    "wendland-c6": (8, (1, 8, 25, 32)),
}


def radial_derivatives(name: str, count: int) -> Floats:
    """(count, N + 1) coefficients c with ``ψ_k(ξ) = ξ^(−2k) Σ_n c[k − 1, n] ξⁿ``, k = 1 … count."""
    power, factor = EXPANDABLE[name]
    a = [Fraction(c) for c in factor]
    for _ in range(power):  # times 1 − ξ
        a = [now - before for now, before in zip([*a, Fraction(0)], [Fraction(0), *a], strict=True)]
    rows = [[float(c * prod(n - 2 * i for i in range(k))) for n, c in enumerate(a)] for k in range(1, count + 1)]
    return np.array(rows)


def monomials(dimension: int) -> list[tuple[int, ...]]:
    """Axes of each monomial of degree 1, 2, 3: ``(0,), (1,), (0, 0), (0, 1), …``, in the order of the coefficients."""
    return [axes for degree in (1, 2, 3) for axes in combinations_with_replacement(range(dimension), degree)]


def expand(interpolant: Interpolant, points: Floats) -> Floats:
    """Taylor coefficients of an interpolant about points.

    Parameters
    ----------
    interpolant : Interpolant
        With a basis of :data:`EXPANDABLE`.
    points : (g, d) array, mesh length unit

    Returns
    -------
    (g, k, c) array
        ``S_i(p + y) ≈ S_i(p) + Σ_c out[p, i, c] · monomial_c(y)``, in the order of :func:`monomials`.
    """
    layout, d = interpolant.layout, points.shape[1]
    terms = monomials(d)
    weights = np.ascontiguousarray(interpolant.weights[layout.order].T)
    out = np.empty((len(points), weights.shape[0], len(terms)))
    derivatives = radial_derivatives(interpolant.basis.name, 3)
    kernels.expand(
        padded(points), layout.coordinates, weights, 1.0 / interpolant.support_radius, derivatives, *layout.grid, out
    )
    out *= np.array([1.0 / prod(factorial(axes.count(axis)) for axis in set(axes)) for axes in terms])
    if interpolant.polynomial is not None:
        out[:, :, :d] += interpolant.polynomial.gradient
    return out


def third_order_norms(coefficients: Floats, dimension: int) -> Floats:
    """(g,) Frobenius norm of the third derivatives of all components of (g, k, c) Taylor coefficients."""
    total = np.zeros(len(coefficients))
    for column, axes in enumerate(monomials(dimension)):
        if len(axes) == 3:
            repeats = prod(factorial(axes.count(axis)) for axis in set(axes))
            # ∂_abc occurs 6 / repeats times in the full tensor, and equals the coefficient times repeats
            total += 6.0 * repeats * np.sum(coefficients[:, :, column] ** 2, axis=1)
    return np.sqrt(total)
