"""Displacements and loads between two meshes of one interface that do not match.

A radial basis function interpolant with a linear polynomial takes displacements from the solid's nodes to any points of
the fluid's side: u_f = H u_s. Translations, rotations and every other linear field are reproduced exactly. Loads go the
other way with the transpose, f_s = Hᵀ f_f: their sum, their moment about the reference positions and their work on
mapped displacements are kept exactly for all meshes (Farhat, Lesoinne and Le Tallec 1998). The basis function is the
thin-plate spline, which needs no radius.

References
----------
C. Farhat, M. Lesoinne, P. Le Tallec, Load and motion transfer algorithms for fluid/structure interaction problems with
non-matching discrete interfaces, Computer Methods in Applied Mechanics and Engineering 157 (1998) 95-114.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mesh_motion_fsi.errors import SetupError

__all__ = ["Mapping"]

Array = NDArray[np.float64]


class Mapping:
    """Mapping of values at ``sources`` to values at ``targets``, and of loads back.

    Parameters
    ----------
    sources : (k, d) array
        Reference places of the solid's interface nodes, length unit. The solve has a dense matrix: up to some thousand
        nodes are practical.
    targets : (m, d) array
        Reference places on the fluid's side, length unit.

    Attributes
    ----------
    matrix : (m, k) array
        H; its rows sum to one.

    Raises
    ------
    SetupError
        Arrays of wrong shape, or two sources at one place.
    """

    def __init__(self, sources: ArrayLike, targets: ArrayLike) -> None:
        x, y = np.asarray(sources, dtype=np.float64), np.asarray(targets, dtype=np.float64)
        if x.ndim != 2 or y.ndim != 2 or x.shape[1] != y.shape[1] or not len(x):
            raise SetupError(f"places must have shapes (k, d) and (m, d), not {x.shape} and {y.shape}")
        centre, size = x.mean(axis=0), float(np.ptp(x, axis=0).max()) or 1.0
        x, y = (x - centre) / size, (y - centre) / size
        gaps = _distances(x, x) + 2.0 * np.eye(len(x))
        if gaps.min() < 1e-10:
            first, second = np.unravel_index(int(gaps.argmin()), gaps.shape)
            raise SetupError(f"sources {first} and {second} are at one place")
        self.matrix: Array = _interpolation(x, y)

    def displacements(self, values: ArrayLike) -> Array:
        """Values (k, c) at the sources, interpolated to the targets: (m, c). Linear fields are exact."""
        return np.asarray(self.matrix @ np.asarray(values, dtype=np.float64))

    def loads(self, forces: ArrayLike) -> Array:
        """Forces (m, c) at the targets as forces (k, c) at the sources with the same sum, moment and work."""
        return np.asarray(self.matrix.T @ np.asarray(forces, dtype=np.float64))


def _interpolation(x: Array, y: Array) -> Array:
    """H (m, k): thin-plate splines and a linear polynomial.

    The polynomial is fitted first, and the spline interpolates the rest in the subspace without polynomials. So points
    on a line or a plane, for which the polynomial is not unique, need no special case.
    """
    polynomial, rest = _linear(x), _spline(x, x)
    u, sizes, _ = np.linalg.svd(polynomial, full_matrices=True)
    rank = int((sizes > 1e-10 * sizes[0]).sum())
    fit = np.linalg.pinv(polynomial, rcond=1e-10)
    free = u[:, rank:]
    # coefficients of the splines: w = N (Nᵀ Φ N)⁻¹ Nᵀ f; of the polynomial: P⁺ (f - Φ w)
    splines = free @ np.linalg.solve(free.T @ rest @ free, free.T) if free.shape[1] else np.zeros_like(rest)
    return np.asarray(_spline(y, x) @ splines + _linear(y) @ fit @ (np.eye(len(x)) - rest @ splines))


def _linear(x: Array) -> Array:
    """(n, 1 + d): one and the coordinates."""
    return np.hstack([np.ones((len(x), 1)), x])


def _distances(x: Array, y: Array) -> Array:
    """(n, m) distances."""
    return np.asarray(np.linalg.norm(x[:, None, :] - y[None, :, :], axis=2))


def _spline(x: Array, y: Array) -> Array:
    """r² log r, zero at zero."""
    r = _distances(x, y)
    return np.asarray(r**2 * np.log(np.where(r > 0.0, r, 1.0)))
