"""An interpolant around a point: all derivatives up to the third, hence ∇S in the neighbourhood to second order.

With ``y = x − x_j``, ``ξ = |y|/R`` and ``ψ_k(ξ) = (1/ξ d/dξ)^k φ(ξ)`` the derivatives of a radial function are ::

    ∂_a φ = ψ_1 y_a / R²
    ∂_ab φ = ψ_1 δ_ab / R² + ψ_2 y_a y_b / R⁴
    ∂_abc φ = ψ_2 (δ_ab y_c + δ_ac y_b + δ_bc y_a) / R⁴ + ψ_3 y_a y_b y_c / R⁶

Wendland's functions are polynomials ``φ = Σ_n a_n ξⁿ`` without a linear term (C2, C4, C6), so that every ψ_k is one
too, up to a power: ``ψ_k = Σ_n a_n n (n − 2) … (n − 2k + 2) ξ^(n − 2k)``. Only they are expanded here.

A group's polynomial is kept as the coefficients of the monomials of ``x − centre`` of degree 1 to 3 (the value at the
centre moves all nodes of a cell alike and says nothing about its quality).
"""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations_with_replacement
from math import factorial, prod

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.numerics.centres import padded
from mesh_motion_server.numerics.interpolant import Interpolant
from mesh_motion_server.numerics.summation import MAX_RUNS, TILE, centre_runs
from mesh_motion_server.numerics.threads import threads_for

__all__ = ["EXPANDABLE", "expand", "monomials", "radial_derivatives", "third_order_norms"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: (1 − ξ)^p q(ξ): p and the coefficients of q, lowest first, from thesis Table 2.1. Exact, so that no odd power below
#: the first true one leaves a rounding error that ξ^(n − 2k) would blow up.
EXPANDABLE: dict[str, tuple[int, tuple[Fraction | int, ...]]] = {
    "wendland-c2": (4, (1, 4)),
    "wendland-c4": (6, (1, 6, Fraction(35, 3))),
    "wendland-c6": (8, (1, 8, 25, 32)),
}

# closer to a centre than this share of R all odd derivatives are zero: the functions are even
_AT_CENTRE = 1e-9


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
    layout, d = interpolant.layout, interpolant.dimension
    terms = monomials(d)
    weights = layout.sort(interpolant.weights)
    out = np.zeros((len(points), weights.shape[0], len(terms)))
    derivatives = radial_derivatives(interpolant.basis.name, 3)
    with threads_for(len(points) * layout.fraction * layout.n_centres * 10):
        _expand(padded(points), layout.coordinates, weights, 1.0 / interpolant.support_radius, derivatives,
                *layout.grid(), out)  # fmt: skip
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
            # ∂_abc occurs 6 / repeats times in the full tensor, and is the coefficient times repeats
            total += 6.0 * repeats * np.sum(coefficients[:, :, column] ** 2, axis=1)
    return np.sqrt(total)


@njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract"})
def _psi_tile(x, y, z, cx, cy, cz, inverse_radius, derivatives, tile):  # type: ignore[no-untyped-def]
    """ψ_1/R², ψ_2/R⁴, ψ_3/R⁶ and y of every centre of a tile; fills ``tile`` (6, TILE)."""
    inverse2 = inverse_radius * inverse_radius
    degree = derivatives.shape[1] - 1
    one, two, three, along_x, along_y, along_z = tile[0], tile[1], tile[2], tile[3], tile[4], tile[5]
    inverse4 = inverse2 * inverse2
    for j in range(cx.size):
        dx, dy, dz = x - cx[j], y - cy[j], z - cz[j]
        s = (dx * dx + dy * dy + dz * dz) * inverse2
        xi = np.sqrt(s)
        first, second, third = derivatives[0, degree], derivatives[1, degree], derivatives[2, degree]
        for n in range(degree - 1, -1, -1):
            first = first * xi + derivatives[0, n]
            second = second * xi + derivatives[1, n]
            third = third * xi + derivatives[2, n]
        inside = 1.0 if xi < 1.0 else 0.0
        away = inside if xi > _AT_CENTRE else 0.0
        per = 1.0 / max(s, _AT_CENTRE * _AT_CENTRE)
        one[j] = (first * per * inside if xi > _AT_CENTRE else derivatives[0, 2]) * inverse2
        two[j] = second * per * per * inverse4 * away
        three[j] = third * per * per * per * inverse4 * inverse2 * away
        along_x[j], along_y[j], along_z[j] = dx, dy, dz


@njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract"})
def _dot2(p, a):  # type: ignore[no-untyped-def]
    total = 0.0
    for j in range(p.size):
        total += p[j] * a[j]
    return total


@njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract"})
def _dot3(p, a, b):  # type: ignore[no-untyped-def]
    total = 0.0
    for j in range(p.size):
        total += p[j] * a[j] * b[j]
    return total


@njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract"})
def _dot4(p, a, b, c):  # type: ignore[no-untyped-def]
    total = 0.0
    for j in range(p.size):
        total += p[j] * a[j] * b[j] * c[j]
    return total


@njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract"})
def _times(p, w, out):  # type: ignore[no-untyped-def]
    total = 0.0
    for j in range(p.size):
        out[j] = p[j] * w[j]
        total += out[j]
    return total


@njit(cache=True, error_model="numpy")
def _add_tile(tile, count, weights, scratch, d, out):  # type: ignore[no-untyped-def]
    """Add the derivatives of a tile's centres, times a component's weights (count,), to out (c,)."""
    first, second, third = scratch[0, :count], scratch[1, :count], scratch[2, :count]
    isotropic = _times(tile[0, :count], weights, first)
    _times(tile[1, :count], weights, second)
    _times(tile[2, :count], weights, third)
    along = np.empty(d)
    place = 0
    for a in range(d):
        along[a] = _dot2(second, tile[3 + a, :count])
        out[place] += _dot2(first, tile[3 + a, :count])
        place += 1
    for a in range(d):
        for b in range(a, d):
            out[place] += _dot3(second, tile[3 + a, :count], tile[3 + b, :count]) + (isotropic if a == b else 0.0)
            place += 1
    for a in range(d):
        for b in range(a, d):
            for c in range(b, d):
                total = _dot4(third, tile[3 + a, :count], tile[3 + b, :count], tile[3 + c, :count])
                if a == b:
                    total += along[c]
                if b == c:
                    total += along[a]
                if a == c:
                    total += along[b]
                out[place] += total
                place += 1


@njit(cache=True, error_model="numpy", parallel=True)
def _expand(  # type: ignore[no-untyped-def]
    points, centres, weights, inverse_radius, derivatives, origin, inverse_side, shape, starts, out
):
    """Derivatives (not yet divided by factorials) at points (g, 3) into out (g, k, c); grid as in ``summation.py``."""
    n, k, terms = out.shape
    d = 1 if terms == 3 else (2 if terms == 9 else 3)
    for i in prange(n):
        tile, scratch = np.empty((6, TILE)), np.empty((3, TILE))
        runs = np.empty((MAX_RUNS, 2), dtype=np.int64)
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for run in range(centre_runs(x, y, z, origin, inverse_side, shape, starts, runs)):
            for a in range(runs[run, 0], runs[run, 1], TILE):
                b = min(a + TILE, runs[run, 1])
                _psi_tile(x, y, z, centres[0, a:b], centres[1, a:b], centres[2, a:b], inverse_radius, derivatives, tile)
                for component in range(k):
                    _add_tile(tile, b - a, weights[component, a:b], scratch, d, out[i, component])
