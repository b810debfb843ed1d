"""The basis functions over arrays, one loop a function, each of vector instructions.

A choice inside a loop would keep the compiler from them, and so would a second array, which might overlap the first.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mesh_motion_server.numerics import kernel_functions as f

__all__ = ["map_phi", "map_slope"]

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def map_phi(code: int, xi: Array) -> None:  # noqa: PLR0912 - a table
    """φ instead of every ξ of ``xi`` (n,)."""
    if code == f.WENDLAND_C2:
        for i in range(xi.size):
            xi[i] = f.wendland_c2(xi[i])
    elif code == f.WENDLAND_C0:
        for i in range(xi.size):
            xi[i] = f.wendland_c0(xi[i])
    elif code == f.WENDLAND_C4:
        for i in range(xi.size):
            xi[i] = f.wendland_c4(xi[i])
    elif code == f.WENDLAND_C6:
        for i in range(xi.size):
            xi[i] = f.wendland_c6(xi[i])
    elif code == f.CTPS_C0:
        for i in range(xi.size):
            xi[i] = f.ctps_c0(xi[i])
    elif code == f.CTPS_C1:
        for i in range(xi.size):
            xi[i] = f.ctps_c1(xi[i])
    elif code == f.CTPS_C2A:
        for i in range(xi.size):
            xi[i] = f.ctps_c2a(xi[i])
    elif code == f.CTPS_C2B:
        for i in range(xi.size):
            xi[i] = f.ctps_c2b(xi[i])
    elif code == f.TPS:
        for i in range(xi.size):
            xi[i] = f.tps(xi[i])
    elif code == f.MQB:
        for i in range(xi.size):
            xi[i] = f.mqb(xi[i])
    elif code == f.IMQB:
        for i in range(xi.size):
            xi[i] = f.imqb(xi[i])
    elif code == f.QB:
        for i in range(xi.size):
            xi[i] = f.qb(xi[i])
    elif code == f.IQB:
        for i in range(xi.size):
            xi[i] = f.iqb(xi[i])
    else:
        for i in range(xi.size):
            xi[i] = f.gauss(xi[i])


@njit(cache=True, error_model="numpy")
def map_slope(code: int, xi: Array) -> None:  # noqa: PLR0912 - a table
    """φ'/ξ instead of every ξ of ``xi`` (n,)."""
    if code == f.WENDLAND_C2:
        for i in range(xi.size):
            xi[i] = f.wendland_c2_slope(xi[i])
    elif code == f.WENDLAND_C0:
        for i in range(xi.size):
            xi[i] = f.wendland_c0_slope(xi[i])
    elif code == f.WENDLAND_C4:
        for i in range(xi.size):
            xi[i] = f.wendland_c4_slope(xi[i])
    elif code == f.WENDLAND_C6:
        for i in range(xi.size):
            xi[i] = f.wendland_c6_slope(xi[i])
    elif code == f.CTPS_C0:
        for i in range(xi.size):
            xi[i] = f.ctps_c0_slope(xi[i])
    elif code == f.CTPS_C1:
        for i in range(xi.size):
            xi[i] = f.ctps_c1_slope(xi[i])
    elif code == f.CTPS_C2A:
        for i in range(xi.size):
            xi[i] = f.ctps_c2a_slope(xi[i])
    elif code == f.CTPS_C2B:
        for i in range(xi.size):
            xi[i] = f.ctps_c2b_slope(xi[i])
    elif code == f.TPS:
        for i in range(xi.size):
            xi[i] = f.tps_slope(xi[i])
    elif code == f.MQB:
        for i in range(xi.size):
            xi[i] = f.mqb_slope(xi[i])
    elif code == f.IMQB:
        for i in range(xi.size):
            xi[i] = f.imqb_slope(xi[i])
    elif code == f.QB:
        for i in range(xi.size):
            xi[i] = f.qb_slope(xi[i])
    elif code == f.IQB:
        for i in range(xi.size):
            xi[i] = f.iqb_slope(xi[i])
    else:
        for i in range(xi.size):
            xi[i] = f.gauss_slope(xi[i])
