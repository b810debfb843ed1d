"""The basis functions of thesis Tables 2.1 and 2.2 as compiled scalar functions of ξ = r/R.

For each basis there are φ(ξ) and the *slope* φ'(ξ)/ξ, which is what a gradient needs: ``∇φ = slope(ξ) (x − x_j) / R²``.
Both are functions of a number ``ξ ≥ 0``; compact ones are zero for ξ > 1. Terms with a logarithm take their limit at
ξ = 0: zero for φ, and for the slopes that diverge there too (they are multiplied by the vector x − x_j = 0).

:func:`phi` and :func:`slope` choose by the ``code`` of :class:`~mesh_motion_server.numerics.kernels.Basis`. Only the
default, Wendland C2, is worth a branch-free vectorised loop of its own; see ``summation.py``.

Notes
-----
The printed coefficient 20/3 of CTPS C1 is 80/3: only then is φ(1) = 0. "(1 − ξ)" means max(0, 1 − ξ).
"""

from __future__ import annotations

import math

from numba import njit

__all__ = ["CODES", "phi", "slope", "wendland_c2", "wendland_c2_slope"]

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
def _log(xi: float) -> float:
    """log ξ, and 0 at ξ = 0, where every term that holds it has the limit 0 or multiplies a zero vector."""
    return math.log(xi) if xi > 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def _phi_wendland(code: int, xi: float) -> float:
    t = 1.0 - xi
    if code == WENDLAND_C2:
        return wendland_c2(xi)
    if code == WENDLAND_C0:
        return t * t
    if code == WENDLAND_C4:
        return t**6 * ((35.0 / 3.0 * xi + 6.0) * xi + 1.0)
    return t**8 * (((32.0 * xi + 25.0) * xi + 8.0) * xi + 1.0)


@njit(cache=True, error_model="numpy")
def _slope_wendland(code: int, xi: float) -> float:
    t = 1.0 - xi
    if code == WENDLAND_C2:
        return wendland_c2_slope(xi)
    if code == WENDLAND_C0:
        return -2.0 * t / xi if xi > 0.0 else 0.0
    if code == WENDLAND_C4:
        return -56.0 / 3.0 * t**5 * (5.0 * xi + 1.0)
    return -22.0 * t**7 * ((16.0 * xi + 7.0) * xi + 1.0)


@njit(cache=True, error_model="numpy")
def _phi_ctps(code: int, xi: float) -> float:
    x2 = xi * xi
    x3 = x2 * xi
    x4 = x2 * x2
    x5 = x3 * x2
    if code == CTPS_C0:
        return (1.0 - xi) ** 5
    if code == CTPS_C1:
        return 1.0 + 80.0 / 3.0 * x2 - 40.0 * x3 + 15.0 * x4 - 8.0 / 3.0 * x5 + 20.0 * x2 * _log(xi)
    if code == CTPS_C2A:
        return 1.0 - 30.0 * x2 - 10.0 * x3 + 45.0 * x4 - 6.0 * x5 - 60.0 * x3 * _log(xi)
    return 1.0 - 20.0 * x2 + 80.0 * x3 - 45.0 * x4 - 16.0 * x5 + 60.0 * x4 * _log(xi)


@njit(cache=True, error_model="numpy")
def _slope_ctps(code: int, xi: float) -> float:
    x2 = xi * xi
    x3 = x2 * xi
    if code == CTPS_C0:
        return -5.0 * (1.0 - xi) ** 4 / xi if xi > 0.0 else 0.0
    if code == CTPS_C1:
        return 220.0 / 3.0 - 120.0 * xi + 60.0 * x2 - 40.0 / 3.0 * x3 + 40.0 * _log(xi) if xi > 0.0 else 0.0
    if code == CTPS_C2A:
        return -60.0 - 90.0 * xi + 180.0 * x2 - 30.0 * x3 - 180.0 * xi * _log(xi)
    return -40.0 + 240.0 * xi - 120.0 * x2 - 80.0 * x3 + 240.0 * x2 * _log(xi)


@njit(cache=True, error_model="numpy")
def _phi_global(code: int, xi: float) -> float:
    s = xi * xi
    if code == TPS:
        return s * _log(xi)
    if code == MQB:
        return math.sqrt(1.0 + s)
    if code == IMQB:
        return 1.0 / math.sqrt(1.0 + s)
    if code == IQB:
        return 1.0 / (1.0 + s)
    if code == GAUSS:
        return math.exp(-s)
    return 1.0 + s


@njit(cache=True, error_model="numpy")
def _slope_global(code: int, xi: float) -> float:
    s = xi * xi
    if code == TPS:
        return 2.0 * _log(xi) + 1.0 if xi > 0.0 else 0.0
    if code == MQB:
        return 1.0 / math.sqrt(1.0 + s)
    if code == IMQB:
        return -1.0 / ((1.0 + s) * math.sqrt(1.0 + s))
    if code == IQB:
        return -2.0 / ((1.0 + s) * (1.0 + s))
    if code == GAUSS:
        return -2.0 * math.exp(-s)
    return 2.0


@njit(cache=True, error_model="numpy")
def phi(code: int, xi: float) -> float:
    """φ(ξ) of the basis with this code."""
    if code >= TPS:
        return _phi_global(code, xi)
    if xi > 1.0:
        return 0.0
    return _phi_ctps(code, xi) if code >= CTPS_C0 else _phi_wendland(code, xi)


@njit(cache=True, error_model="numpy")
def slope(code: int, xi: float) -> float:
    """φ'(ξ)/ξ of the basis with this code; at ξ = 0 its limit, or 0 where it diverges."""
    if code >= TPS:
        return _slope_global(code, xi)
    if xi > 1.0:
        return 0.0
    return _slope_ctps(code, xi) if code >= CTPS_C0 else _slope_wendland(code, xi)
