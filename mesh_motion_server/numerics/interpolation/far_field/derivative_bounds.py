"""Bounds of the derivatives of a basis function along any line, by distance: what interpolation in a box can miss.

A polynomial of p Chebyshev points an axis in a box with half sides a_m misses a function f by at most
``Σ_m Λ_p^(m−1) 2 (a_m/2)^p max|∂_m^p f|/p!``, Λ_p the Lebesgue constant. For ``f(x) = φ(|x − y|/R)`` the maximum is
taken over all directions and all distances from D on.

Nearly all basis functions are sums of powers ``r^k`` and ``r^k log r``. Along a line from distance D, at an angle to
the centre with cosine c, ``(r/D)^k = (1 + 2ct + t²)^(k/2)`` is the generating function of Gegenbauer polynomials, so
that ``∂^p r^k / p! = D^(k−p) C_p^(−k/2)(−c)``; the terms with a logarithm are its derivative with respect to k. A
multiquadric ``(1 + r²)^(k/2)`` is a power of the distance in a space with one more dimension; for Gauss' function there
is Cramér's inequality.

References
----------
P. J. Davis, "Interpolation and Approximation", Dover 1975, §3.1 (the remainder). L. Brutman, SIAM J. Numer. Anal. 15
(1978) 694–704 (Λ_p). NIST Digital Library of Mathematical Functions, 18.9.1, 18.12.4, 18.14.9.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from mesh_motion_server.numerics.interpolation.kernels import Basis

__all__ = ["ORDERS", "DerivativeBounds", "derivative_bounds", "lebesgue_constant"]

Floats = NDArray[np.float64]

ORDERS = range(2, 11)
"""Points an axis that a polynomial may have."""

#: Distances tabulated: 2^(i/8 − 24) R.
_PER_OCTAVE, _FIRST = 8, -24
#: Cosines at which Gegenbauer polynomials are taken; of degree p, they exceed what is found by 1/cos(pπ/2n) at most.
_COSINES = 400

#: Coefficients of ξ^0, ξ^1, … and those of ξ^k log ξ.
_POWERS: dict[str, Polynomial] = {
    "wendland-c0": Polynomial([1, -1]) ** 2,
    "wendland-c2": Polynomial([1, -1]) ** 4 * Polynomial([1, 4]),
    "wendland-c4": Polynomial([1, -1]) ** 6 * Polynomial([1, 6, 35 / 3]),
    "wendland-c6": Polynomial([1, -1]) ** 8 * Polynomial([1, 8, 25, 32]),
    "ctps-c0": Polynomial([1, -1]) ** 5,
    "ctps-c1": Polynomial([1, 0, 80 / 3, -40, 15, -8 / 3]),
    "ctps-c2a": Polynomial([1, 0, -30, -10, 45, -6]),
    "ctps-c2b": Polynomial([1, 0, -20, 80, -45, -16]),
    "tps": Polynomial([0]),
}
_LOGARITHMS: dict[str, tuple[int, float]] = {
    "ctps-c1": (2, 20.0),
    "ctps-c2a": (3, -60.0),
    "ctps-c2b": (4, 60.0),
    "tps": (2, 1.0),
}
#: Compact functions vanish at R as (1 − ξ)^m: m derivatives are bounded across it.
_ZEROS = {
    "wendland-c0": 2,
    "wendland-c2": 4,
    "wendland-c4": 6,
    "wendland-c6": 8,
    "ctps-c0": 5,
    "ctps-c1": 5,
    "ctps-c2a": 5,
    "ctps-c2b": 5,
}
#: φ = (1 + ξ²)^(k/2).
_QUADRICS = {"mqb": 1, "imqb": -1, "iqb": -2}
#: |H_n(x)| exp(−x²/2) ≤ 1.0865 √(2^n n!).
_CRAMER = 1.0865


@dataclass(frozen=True, eq=False)
class DerivativeBounds:
    """Bounds of ``|∂^p φ|/p!`` along any line, ξ = r/R as length.

    Attributes
    ----------
    table : (max order + 1, 1 + distances) array
        Column 0 is for any distance, column i + 1 for those from ``distances[i]`` on; infinite where there is no bound.
    distances : (distances,) array
        Ascending.
    reach : float
        φ is zero from here on; infinite for a basis without compact support.
    across : int
        Highest order whose bound holds in a box that the function's end at ``reach`` crosses.
    """

    table: Floats
    distances: Floats
    reach: float
    across: int


def lebesgue_constant(order: int) -> float:
    """Λ of Chebyshev points: how much a polynomial through them may exceed its values there."""
    angles = (2.0 * np.arange(1, order + 1) - 1.0) * math.pi / (4.0 * order)
    return float(np.sum(1.0 / np.tan(angles)) / order)


def derivative_bounds(basis: Basis, furthest: float) -> DerivativeBounds:
    """Bounds for distances up to ``furthest``, in support radii."""
    octaves = 0 if basis.compact else math.ceil(math.log2(max(furthest, 1.0)))
    return _tabulated(basis, octaves)


@lru_cache(maxsize=32)
def _tabulated(basis: Basis, octaves: int) -> DerivativeBounds:
    """The table up to distance 2^octaves."""
    count = (octaves - _FIRST) * _PER_OCTAVE + 1
    distances = np.concatenate([[0.0], 2.0 ** (np.arange(count) / _PER_OCTAVE + _FIRST)])
    table = np.full((ORDERS[-1] + 1, len(distances)), np.inf)
    for order in ORDERS:
        table[order] = _bound(basis, order, distances, 2.0**octaves)
    table.setflags(write=False)
    reach = 1.0 if basis.compact else math.inf
    return DerivativeBounds(table, distances[1:].copy(), reach, _ZEROS.get(basis.name, ORDERS[-1]))


def _bound(basis: Basis, order: int, distances: Floats, furthest: float) -> Floats:
    """(n,) bounds for one order at all distances from ``distances`` (n,) to ``furthest``."""
    if basis.name in _QUADRICS:
        power = _QUADRICS[basis.name]
        return np.asarray(_gegenbauer(power, order)[0] * (1.0 + distances**2) ** ((power - order) / 2.0))
    if basis.name == "gauss":
        return np.asarray(_CRAMER * math.sqrt(2.0**order / math.factorial(order)) * np.exp(-(distances**2) / 2.0))
    total = np.zeros_like(distances)
    for power, coefficient in enumerate(map(float, _POWERS[basis.name].coef)):
        largest = abs(coefficient) * _gegenbauer(power, order)[0]
        if largest > 0.0:
            total += largest * _power(distances, power - order, furthest)
    if basis.name in _LOGARITHMS:
        power, factor = _LOGARITHMS[basis.name]
        plain, logarithmic = _gegenbauer(power, order)
        total += abs(factor) * logarithmic * _power(distances, power - order, furthest)
        if plain > 0.0:
            total += abs(factor) * plain * _log_power(distances, power - order, furthest)
    return total


def _power(distances: Floats, exponent: int, furthest: float) -> Floats:
    """(n,) largest r^exponent for r from ``distances`` (n,) to ``furthest``."""
    if exponent >= 0:
        return np.full_like(distances, furthest**exponent)
    with np.errstate(divide="ignore"):
        return np.asarray(distances ** float(exponent))


def _log_power(distances: Floats, exponent: int, furthest: float) -> Floats:
    """(n,) at least the largest |log r| r^exponent for r from ``distances`` (n,) to ``furthest``."""
    beyond_one = math.log(furthest) * furthest ** max(exponent, 0)
    if exponent > 0:
        return np.full_like(distances, max(beyond_one, 1.0 / (math.e * exponent)))
    with np.errstate(divide="ignore"):
        below_one = np.maximum(-np.log(distances), 0.0) * distances ** float(exponent)
    return np.asarray(np.maximum(beyond_one, below_one))


@lru_cache(maxsize=256)
def _gegenbauer(power: int, order: int) -> tuple[float, float]:
    """Largest Taylor coefficients of u^power and u^power log u along a line, u² = 1 + 2ct + t², over all cosines c.

    Those of polynomials are exactly zero.
    """
    x = np.cos(np.linspace(0.0, math.pi, _COSINES + 1))
    weight = -0.5 * power
    before, now = np.zeros_like(x), np.ones_like(x)
    slope_before, slope_now = np.zeros_like(x), np.zeros_like(x)  # with respect to the weight
    for n in range(1, order + 1):
        a, b = n + weight - 1.0, n + 2.0 * weight - 2.0
        slope = (2.0 * x * (a * slope_now + now) - (b * slope_before + 2.0 * before)) / n
        slope_before, slope_now = slope_now, slope
        before, now = now, (2.0 * x * a * now - b * before) / n
    excess = 1.0 / math.cos(order * math.pi / (2.0 * _COSINES))
    polynomial = power >= 0 and power % 2 == 0 and order > power
    plain = 0.0 if polynomial else float(np.max(np.abs(now))) * excess
    return plain, 0.5 * float(np.max(np.abs(slope_now))) * excess
