"""The basis functions of thesis Tables 2.1 and 2.2 as compiled scalar functions of ξ = r/R.

For each basis there are φ(ξ) and the *slope* φ'(ξ)/ξ, which is what a gradient needs: ``∇φ = slope(ξ) (x − x_j) / R²``.
Both are functions of a number ``ξ ≥ 0``; compact ones are zero for ξ > 1. Terms with a logarithm take their limit at
ξ = 0: zero for φ, and for the slopes that diverge there too (they are multiplied by the vector x − x_j = 0).

Every function is free of branches and of calls into a library, so that a loop over an array (``kernel_maps.py``)
becomes vector instructions; the logarithm and the exponential are therefore written out. :func:`phi` and :func:`slope`
choose by the ``code`` of :class:`~mesh_motion_server.numerics.kernels.Basis`, for a single number.

Notes
-----
The printed coefficient 20/3 of CTPS C1 is 80/3: only then is φ(1) = 0. "(1 − ξ)" means max(0, 1 − ξ).

References
----------
The logarithm is the series of (m − 1)/(m + 1) with the coefficients of FreeBSD's ``e_log.c`` (below 1 ulp), the
exponential that of S. L. Moshier, "Methods and Programs for Mathematical Functions", Ellis Horwood 1989 (below 3 ulp).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

__all__ = ["CODES", "phi", "slope"]

WENDLAND_C2 = 0
WENDLAND_C0 = 1
WENDLAND_C4 = 2
WENDLAND_C6 = 3
CTPS_C0 = 4
CTPS_C1 = 5
CTPS_C2A = 6
CTPS_C2B = 7
TPS = 8
MQB = 9
IMQB = 10
QB = 11
IQB = 12
GAUSS = 13

CODES: dict[str, int] = {
    "wendland-c0": WENDLAND_C0,
    "wendland-c2": WENDLAND_C2,
    "wendland-c4": WENDLAND_C4,
    "wendland-c6": WENDLAND_C6,
    "ctps-c0": CTPS_C0,
    "ctps-c1": CTPS_C1,
    "ctps-c2a": CTPS_C2A,
    "ctps-c2b": CTPS_C2B,
    "tps": TPS,
    "mqb": MQB,
    "imqb": IMQB,
    "qb": QB,
    "iqb": IQB,
    "gauss": GAUSS,
}


#: log 2 in two parts; the first has so few digits that its product with an exponent is exact.
_LOG_2_HIGH, _LOG_2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
#: Bits of √½: numbers are scaled by a power of two to lie within a factor √2 of 1.
_ROOT_HALF = 0x3FE6A09E667F3BCD
_MANTISSA, _BIAS = 52, 1023
#: The same parts for the exponential, whose exponents are shorter, and 1/log 2.
_EXP_HIGH, _EXP_LOW, _PER_LOG_2 = 6.93145751953125e-1, 1.42860682030941723212e-6, 1.4426950408889634
#: exp of less is taken as 0.
_SMALLEST = -708.0


@njit(cache=True, error_model="numpy")
def _log(xi: float) -> float:
    """log ξ, and 0 at ξ = 0, where every term that holds it has the limit 0 or multiplies a zero vector."""
    bits = np.float64(xi).view(np.int64)
    exponent = (bits - _ROOT_HALF) >> _MANTISSA
    f = np.int64(bits - (exponent << _MANTISSA)).view(np.float64) - 1.0
    s = f / (2.0 + f)
    z = s * s
    series = z * (
        6.666666666666735130e-01
        + z
        * (
            3.999999999940941908e-01
            + z
            * (
                2.857142874366239149e-01
                + z
                * (
                    2.222219843214978396e-01
                    + z * (1.818357216161805012e-01 + z * (1.531383769920937332e-01 + z * 1.479819860511658591e-01))
                )
            )
        )
    )
    half, scale = 0.5 * f * f, float(exponent)
    value = scale * _LOG_2_HIGH - ((half - (s * (half + series) + scale * _LOG_2_LOW)) - f)
    return value if xi > 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def _exp(x: float) -> float:
    """exp x for x ≤ 0."""
    near = max(x, _SMALLEST)
    exponent = math.floor(near * _PER_LOG_2 + 0.5)
    r = (near - exponent * _EXP_HIGH) - exponent * _EXP_LOW
    z = r * r
    p = r * ((1.26177193074810590878e-4 * z + 3.02994407707441961300e-2) * z + 9.99999999999999999910e-1)
    q = ((3.00198505138664455042e-6 * z + 2.52448340349684104192e-3) * z + 2.27265548208155028766e-1) * z + 2.0
    power = np.int64((np.int64(exponent) + _BIAS) << _MANTISSA).view(np.float64)
    return power * (1.0 + 2.0 * (p / (q - p))) if x > _SMALLEST else 0.0


@njit(cache=True, error_model="numpy")
def wendland_c2(xi: float) -> float:
    """(1 − ξ)⁴ (4ξ + 1)."""
    t = max(0.0, 1.0 - xi)
    t2 = t * t
    return t2 * t2 * (4.0 * xi + 1.0)


@njit(cache=True, error_model="numpy")
def wendland_c2_slope(xi: float) -> float:
    """φ'/ξ = −20 (1 − ξ)³."""
    t = max(0.0, 1.0 - xi)
    return -20.0 * t * t * t


@njit(cache=True, error_model="numpy")
def wendland_c0(xi: float) -> float:
    """(1 − ξ)²."""
    t = max(0.0, 1.0 - xi)
    return t * t


@njit(cache=True, error_model="numpy")
def wendland_c0_slope(xi: float) -> float:
    """φ'/ξ = −2 (1 − ξ)/ξ."""
    return -2.0 * max(0.0, 1.0 - xi) / xi if xi > 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def wendland_c4(xi: float) -> float:
    """(1 − ξ)⁶ (35/3 ξ² + 6ξ + 1)."""
    x = min(xi, 1.0)
    t = 1.0 - x
    return t**6 * ((35.0 / 3.0 * x + 6.0) * x + 1.0)


@njit(cache=True, error_model="numpy")
def wendland_c4_slope(xi: float) -> float:
    """φ'/ξ = −56/3 (5ξ + 1) (1 − ξ)⁵."""
    x = min(xi, 1.0)
    t = 1.0 - x
    return -56.0 / 3.0 * t**5 * (5.0 * x + 1.0)


@njit(cache=True, error_model="numpy")
def wendland_c6(xi: float) -> float:
    """(1 − ξ)⁸ (32ξ³ + 25ξ² + 8ξ + 1)."""
    x = min(xi, 1.0)
    t = 1.0 - x
    return t**8 * (((32.0 * x + 25.0) * x + 8.0) * x + 1.0)


@njit(cache=True, error_model="numpy")
def wendland_c6_slope(xi: float) -> float:
    """φ'/ξ = −22 (16ξ² + 7ξ + 1) (1 − ξ)⁷."""
    x = min(xi, 1.0)
    t = 1.0 - x
    return -22.0 * t**7 * ((16.0 * x + 7.0) * x + 1.0)


@njit(cache=True, error_model="numpy")
def ctps_c0(xi: float) -> float:
    """(1 − ξ)⁵."""
    return max(0.0, 1.0 - xi) ** 5


@njit(cache=True, error_model="numpy")
def ctps_c0_slope(xi: float) -> float:
    """φ'/ξ = −5 (1 − ξ)⁴/ξ."""
    return -5.0 * max(0.0, 1.0 - xi) ** 4 / xi if xi > 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def ctps_c1(xi: float) -> float:
    """1 + 80/3 ξ² − 40ξ³ + 15ξ⁴ − 8/3 ξ⁵ + 20ξ² log ξ."""
    x2 = xi * xi
    x3 = x2 * xi
    value = 1.0 + 80.0 / 3.0 * x2 - 40.0 * x3 + 15.0 * x2 * x2 - 8.0 / 3.0 * x3 * x2 + 20.0 * x2 * _log(xi)
    return value if xi <= 1.0 else 0.0


@njit(cache=True, error_model="numpy")
def ctps_c1_slope(xi: float) -> float:
    """φ'/ξ = 220/3 − 120ξ + 60ξ² − 40/3 ξ³ + 40 log ξ."""
    x2 = xi * xi
    value = 220.0 / 3.0 - 120.0 * xi + 60.0 * x2 - 40.0 / 3.0 * x2 * xi + 40.0 * _log(xi)
    return value if 0.0 < xi <= 1.0 else 0.0


@njit(cache=True, error_model="numpy")
def ctps_c2a(xi: float) -> float:
    """1 − 30ξ² − 10ξ³ + 45ξ⁴ − 6ξ⁵ − 60ξ³ log ξ."""
    x2 = xi * xi
    x3 = x2 * xi
    value = 1.0 - 30.0 * x2 - 10.0 * x3 + 45.0 * x2 * x2 - 6.0 * x3 * x2 - 60.0 * x3 * _log(xi)
    return value if xi <= 1.0 else 0.0


@njit(cache=True, error_model="numpy")
def ctps_c2a_slope(xi: float) -> float:
    """φ'/ξ = −60 − 90ξ + 180ξ² − 30ξ³ − 180ξ log ξ."""
    x2 = xi * xi
    value = -60.0 - 90.0 * xi + 180.0 * x2 - 30.0 * x2 * xi - 180.0 * xi * _log(xi)
    return value if xi <= 1.0 else 0.0


@njit(cache=True, error_model="numpy")
def ctps_c2b(xi: float) -> float:
    """1 − 20ξ² + 80ξ³ − 45ξ⁴ − 16ξ⁵ + 60ξ⁴ log ξ."""
    x2 = xi * xi
    x3, x4 = x2 * xi, x2 * x2
    value = 1.0 - 20.0 * x2 + 80.0 * x3 - 45.0 * x4 - 16.0 * x3 * x2 + 60.0 * x4 * _log(xi)
    return value if xi <= 1.0 else 0.0


@njit(cache=True, error_model="numpy")
def ctps_c2b_slope(xi: float) -> float:
    """φ'/ξ = −40 + 240ξ − 120ξ² − 80ξ³ + 240ξ² log ξ."""
    x2 = xi * xi
    value = -40.0 + 240.0 * xi - 120.0 * x2 - 80.0 * x2 * xi + 240.0 * x2 * _log(xi)
    return value if xi <= 1.0 else 0.0


@njit(cache=True, error_model="numpy")
def tps(xi: float) -> float:
    """ξ² log ξ."""
    return xi * xi * _log(xi)


@njit(cache=True, error_model="numpy")
def tps_slope(xi: float) -> float:
    """φ'/ξ = 2 log ξ + 1."""
    return 2.0 * _log(xi) + 1.0 if xi > 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def mqb(xi: float) -> float:
    """√(1 + ξ²)."""
    return math.sqrt(1.0 + xi * xi)


@njit(cache=True, error_model="numpy")
def mqb_slope(xi: float) -> float:
    """φ'/ξ = 1/√(1 + ξ²)."""
    return 1.0 / math.sqrt(1.0 + xi * xi)


@njit(cache=True, error_model="numpy")
def imqb(xi: float) -> float:
    """1/√(1 + ξ²)."""
    return 1.0 / math.sqrt(1.0 + xi * xi)


@njit(cache=True, error_model="numpy")
def imqb_slope(xi: float) -> float:
    """φ'/ξ = −1/(1 + ξ²)^(3/2)."""
    s = 1.0 + xi * xi
    return -1.0 / (s * math.sqrt(s))


@njit(cache=True, error_model="numpy")
def qb(xi: float) -> float:
    """1 + ξ²."""
    return 1.0 + xi * xi


@njit(cache=True, error_model="numpy")
def qb_slope(_xi: float) -> float:
    """φ'/ξ = 2."""
    return 2.0


@njit(cache=True, error_model="numpy")
def iqb(xi: float) -> float:
    """1/(1 + ξ²)."""
    return 1.0 / (1.0 + xi * xi)


@njit(cache=True, error_model="numpy")
def iqb_slope(xi: float) -> float:
    """φ'/ξ = −2/(1 + ξ²)²."""
    s = 1.0 + xi * xi
    return -2.0 / (s * s)


@njit(cache=True, error_model="numpy")
def gauss(xi: float) -> float:
    """exp(−ξ²)."""
    return _exp(-xi * xi)


@njit(cache=True, error_model="numpy")
def gauss_slope(xi: float) -> float:
    """φ'/ξ = −2 exp(−ξ²)."""
    return -2.0 * _exp(-xi * xi)


@njit(cache=True, error_model="numpy")
def phi(code: int, xi: float) -> float:  # noqa: PLR0911, PLR0912 - a table
    """φ(ξ) of the basis with this code."""
    if code == WENDLAND_C2:
        return wendland_c2(xi)
    if code == WENDLAND_C0:
        return wendland_c0(xi)
    if code == WENDLAND_C4:
        return wendland_c4(xi)
    if code == WENDLAND_C6:
        return wendland_c6(xi)
    if code == CTPS_C0:
        return ctps_c0(xi)
    if code == CTPS_C1:
        return ctps_c1(xi)
    if code == CTPS_C2A:
        return ctps_c2a(xi)
    if code == CTPS_C2B:
        return ctps_c2b(xi)
    if code == TPS:
        return tps(xi)
    if code == MQB:
        return mqb(xi)
    if code == IMQB:
        return imqb(xi)
    if code == QB:
        return qb(xi)
    if code == IQB:
        return iqb(xi)
    return gauss(xi)


@njit(cache=True, error_model="numpy")
def slope(code: int, xi: float) -> float:  # noqa: PLR0911, PLR0912 - a table
    """φ'(ξ)/ξ of the basis with this code; at ξ = 0 its limit, or 0 where it diverges."""
    if code == WENDLAND_C2:
        return wendland_c2_slope(xi)
    if code == WENDLAND_C0:
        return wendland_c0_slope(xi)
    if code == WENDLAND_C4:
        return wendland_c4_slope(xi)
    if code == WENDLAND_C6:
        return wendland_c6_slope(xi)
    if code == CTPS_C0:
        return ctps_c0_slope(xi)
    if code == CTPS_C1:
        return ctps_c1_slope(xi)
    if code == CTPS_C2A:
        return ctps_c2a_slope(xi)
    if code == CTPS_C2B:
        return ctps_c2b_slope(xi)
    if code == TPS:
        return tps_slope(xi)
    if code == MQB:
        return mqb_slope(xi)
    if code == IMQB:
        return imqb_slope(xi)
    if code == QB:
        return qb_slope(xi)
    if code == IQB:
        return iqb_slope(xi)
    return gauss_slope(xi)
