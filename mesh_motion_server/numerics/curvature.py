"""Positive semi-definite blocks of the distortion's Hessian, one per corner simplex, analytic.

With the signed singular value decomposition ``J = U S Vᵀ`` (det U = det V = 1) the Hessian of ℓ with respect to J falls
apart: the stretches ``u_i v_iᵀ`` couple through a d × d matrix, every pair (i, j) has one rotation-like and one
shear-like mode (cf. Smith, de Goes & Kim, Analytic eigensystems for isotropic distortion energies, ACM TOG 38, 2019)::

    t_i = Π_{j≠i} s_j,   t_ij = 1 (2D) | s_k (3D), 0 for i = j,   ℓ_i = 2 s_i/q + h1 t_i
    M_ij = 2 δ_ij/q − 4 s_i s_j/q² + h2 t_i t_j + h1 t_ij + p ℓ_i ℓ_j        eigenpairs (λ, e): mode Σ e_i u_i v_iᵀ
    (u_i v_jᵀ ∓ u_j v_iᵀ)/√2   with   λ = 2/q ± h1 t_ij

In 1D there is no shape: q = ∞, M = h2 + p h1². ``p ℓ_i ℓ_j`` is the rank-one term of the p-mean. Negative λ are
dropped; the rest goes to the nodes through P::

    H_c = (w_c + floor/n) Σ λ v vᵀ
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.numerics.distortion import BLOCK, CornerSimplices, PNorm, jacobian, slopes

__all__ = ["FLOOR", "add_curvature", "corner_blocks"]

FLOOR = 0.1
"""Weight that every corner keeps in the Hessian, in units of the mean weight: no node is without stiffness."""

_JACOBI_SWEEPS, _DIAGONAL = 12, 1e-10  # the last sweep squares what is off the diagonal


def corner_blocks(
    points: NDArray[np.float64],
    simplices: CornerSimplices,
    weights: NDArray[np.float64],
    norm: PNorm,
    blocks: NDArray[np.float32],
    *,
    least_weight: float = 0.0,
    floor: float = FLOOR,
) -> None:
    """Update the blocks (c, d², d²) of the corners heavier than ``least_weight`` in place.

    Row and column ``j d + i`` belong to the coordinate i of the edge j, which ends at node j + 1; the rows of node 0
    are minus the sums. Single precision is enough for a model of the curvature, and halves the memory.
    """
    _corner_blocks(
        points,
        simplices.nodes,
        simplices.ideal,
        weights,
        floor / len(weights),
        norm.p,
        norm.m,
        norm.epsilon,
        norm.size_weight,
        least_weight,
        blocks,
    )


@njit(cache=True, error_model="numpy", forceinline=True)
def _symmetric_eigen(a, k, v):  # type: ignore[no-untyped-def]
    """Cyclic Jacobi: a (k, k) becomes diagonal, the columns of v (k, k) the eigenvectors."""
    for i in range(k):
        for j in range(k):
            v[i, j] = 1.0 if i == j else 0.0
    for _ in range(_JACOBI_SWEEPS):
        off, size = 0.0, 0.0
        for i in range(k):
            size += abs(a[i, i])
            for j in range(i):
                off += abs(a[i, j])
        if not off > _DIAGONAL * size:
            return
        for i in range(1, k):
            for j in range(i):
                _rotate(a, v, k, j, i)


@njit(cache=True, error_model="numpy", forceinline=True)
def _rotate(a, v, n, i, j):  # type: ignore[no-untyped-def]
    """One Jacobi rotation that annihilates a[i, j]."""
    if a[i, j] == 0.0:
        return
    theta = (a[j, j] - a[i, i]) / (2.0 * a[i, j])
    t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
    if theta < 0.0:
        t = -t
    c = 1.0 / math.sqrt(t * t + 1.0)
    s = t * c
    for k in range(n):
        a[k, i], a[k, j] = c * a[k, i] - s * a[k, j], s * a[k, i] + c * a[k, j]
    for k in range(n):
        a[i, k], a[j, k] = c * a[i, k] - s * a[j, k], s * a[i, k] + c * a[j, k]
    for k in range(n):
        v[k, i], v[k, j] = c * v[k, i] - s * v[k, j], s * v[k, i] + c * v[k, j]


@njit(cache=True, error_model="numpy", forceinline=True)
def _signed_svd_2(jac, u, s, v):  # type: ignore[no-untyped-def]
    """Closed form in 2D: J = R(φ) S R(θ), rotations only, s_1 ≥ |s_2|."""
    e, f = 0.5 * (jac[0, 0] + jac[1, 1]), 0.5 * (jac[0, 0] - jac[1, 1])
    g, h = 0.5 * (jac[1, 0] + jac[0, 1]), 0.5 * (jac[1, 0] - jac[0, 1])
    q, r = math.hypot(e, h), math.hypot(f, g)
    s[0], s[1] = q + r, q - r
    a, b = math.atan2(g, f), math.atan2(h, e)
    phi, theta = 0.5 * (b + a), 0.5 * (b - a)
    u[0, 0], u[1, 1], u[1, 0], u[0, 1] = math.cos(phi), math.cos(phi), math.sin(phi), -math.sin(phi)
    v[0, 0], v[1, 1], v[1, 0], v[0, 1] = math.cos(theta), math.cos(theta), -math.sin(theta), math.sin(theta)


@njit(cache=True, error_model="numpy", forceinline=True)
def _cross(a, i, j, k):  # type: ignore[no-untyped-def]
    """Column k of a (3, 3) = column i × column j."""
    for r in range(3):
        r1, r2 = (r + 1) % 3, (r + 2) % 3
        a[r, k] = a[r1, i] * a[r2, j] - a[r2, i] * a[r1, j]


@njit(cache=True, error_model="numpy", forceinline=True)
def _largest_first(gram, v):  # type: ignore[no-untyped-def]
    """Sort the eigenvalues on the diagonal of gram (3, 3), and the columns of v with them."""
    for i in range(2):
        for j in range(i + 1, 3):
            if gram[j, j] > gram[i, i]:
                gram[i, i], gram[j, j] = gram[j, j], gram[i, i]
                for r in range(3):
                    v[r, i], v[r, j] = v[r, j], v[r, i]


@njit(cache=True, error_model="numpy", forceinline=True)
def _signed_svd_3(jac, u, s, v, gram):  # type: ignore[no-untyped-def]
    """Through the eigenvectors of JᵀJ; only the smallest singular value may be negative."""
    for i in range(3):
        for j in range(3):
            gram[i, j] = jac[0, i] * jac[0, j] + jac[1, i] * jac[1, j] + jac[2, i] * jac[2, j]
    _symmetric_eigen(gram, 3, v)
    _largest_first(gram, v)
    _cross(v, 0, 1, 2)
    for k in range(2):
        for r in range(3):
            u[r, k] = jac[r, 0] * v[0, k] + jac[r, 1] * v[1, k] + jac[r, 2] * v[2, k]
        if k == 1:  # orthogonal also where s_2 is lost in the rounding of JᵀJ
            along = u[0, 0] * u[0, 1] + u[1, 0] * u[1, 1] + u[2, 0] * u[2, 1]
            for r in range(3):
                u[r, 1] -= along * u[r, 0]
        s[k] = math.sqrt(u[0, k] ** 2 + u[1, k] ** 2 + u[2, k] ** 2)
        for r in range(3):
            u[r, k] /= s[k]
    _cross(u, 0, 1, 2)
    s[2] = 0.0
    for i in range(3):
        for j in range(3):
            s[2] += u[i, 2] * jac[i, j] * v[j, 2]


@njit(cache=True, error_model="numpy", forceinline=True)
def _stretch_matrix(s, q, law, d, out):  # type: ignore[no-untyped-def]
    """out (d, d) = M of the module's text."""
    weight, h1, h2, p, slope = law
    for i in range(d):
        t_i = 1.0
        for k in range(d):
            t_i *= s[k] if k != i else 1.0
        for j in range(d):
            t_j, t_ij = 1.0, 0.0 if i == j else 1.0
            for k in range(d):
                t_j *= s[k] if k != j else 1.0
                t_ij *= s[k] if k not in (i, j) else 1.0
            rank_one = p * (2.0 * s[i] / q + slope * t_i) * (2.0 * s[j] / q + slope * t_j)
            out[i, j] = -4.0 * weight * s[i] * s[j] / (q * q) + h2 * t_i * t_j + h1 * t_ij + rank_one
        out[i, i] += 2.0 * weight / q


@njit(cache=True, error_model="numpy", forceinline=True)
def _is_positive(a, d):  # type: ignore[no-untyped-def]
    """Whether a symmetric matrix (d, d) has positive leading minors."""
    if not a[0, 0] > 0.0:
        return False
    if d == 1:
        return True
    minor = a[0, 0] * a[1, 1] - a[0, 1] * a[0, 1]
    if d == 2 or not minor > 0.0:
        return minor > 0.0
    x, y = a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1], a[0, 0] * a[1, 2] - a[0, 2] * a[0, 1]
    return a[0, 2] * x - a[1, 2] * y + a[2, 2] * minor > 0.0


@njit(cache=True, error_model="numpy", forceinline=True)
def _project(a, d, vectors, values):  # type: ignore[no-untyped-def]
    """Drop the negative part of a symmetric matrix (d, d) in place."""
    if _is_positive(a, d):
        return
    _symmetric_eigen(a, d, vectors)
    for i in range(d):
        values[i] = max(a[i, i], 0.0)
    for i in range(d):
        for j in range(d):
            a[i, j] = 0.0
            for k in range(d):
                a[i, j] += values[k] * vectors[i, k] * vectors[j, k]


@njit(cache=True, error_model="numpy", forceinline=True)
def _pair_modes(s, q, weight, h1, d, alike, crossed):  # type: ignore[no-untyped-def]
    """alike, crossed (d, d) of the pairs: both modes projected, back in the basis u_i v_jᵀ, u_j v_iᵀ."""
    for i in range(d):
        alike[i, i] = crossed[i, i] = 0.0
        for j in range(i):
            shape, size = weight / q, 0.5 * h1 * (s[3 - i - j] if d == 3 else 1.0)
            rotation, shear = max(shape + size, 0.0), max(shape - size, 0.0)
            alike[i, j] = alike[j, i] = rotation + shear
            crossed[i, j] = crossed[j, i] = shear - rotation


@njit(cache=True, error_model="numpy", parallel=True)
def _corner_blocks(  # type: ignore[no-untyped-def]
    points, corners, ideals, weights, floor, p, m, epsilon, size_weight, least_weight, out
):
    n, d = len(corners), points.shape[1]
    norm = (p, m, epsilon, size_weight)
    for block in prange((n + BLOCK - 1) // BLOCK):
        small, vectors = np.empty((9, d, d)), np.empty((2, d))
        total = np.empty((d * d, d * d))
        for c in range(block * BLOCK, min(n, (block + 1) * BLOCK)):
            if weights[c] < least_weight:
                continue
            weight = weights[c] + floor
            # the literal dimensions let the compiler unroll every small loop
            if d == 3:
                _block(points, corners[c], ideals[c], weight, norm, 3, small, vectors, total, out[c])
            elif d == 2:
                _block(points, corners[c], ideals[c], weight, norm, 2, small, vectors, total, out[c])
            else:
                _block(points, corners[c], ideals[c], weight, norm, 1, small, vectors, total, out[c])


@njit(cache=True, error_model="numpy", forceinline=True)
def _product(a, b, d, out):  # type: ignore[no-untyped-def]
    """out = a b, all (d, d)."""
    for j in range(d):
        for k in range(d):
            t = 0.0
            for r in range(d):
                t += a[j, r] * b[r, k]
            out[j, k] = t


@njit(cache=True, error_model="numpy", forceinline=True)
def _block(  # type: ignore[no-untyped-def]
    points, corner, ideal, weight, norm, d, small, long, total, out
):
    """out (d², d²) of one corner; small, long and total are work space."""
    tau, q = jacobian(points, corner, ideal, d, small[0])
    p, m, epsilon, size_weight = norm
    h1, h2 = slopes(tau, d, m, epsilon, size_weight)
    total[:] = 0.0
    add_curvature(tau, q, ideal, (1.0, h1, h2, p, h1), weight, d, small, long, total)
    for a in range(d * d):
        for b in range(a + 1):
            value = np.float32(total[a, b])
            out[a, b] = value
            out[b, a] = value


@njit(cache=True, error_model="numpy", forceinline=True)
def add_curvature(  # type: ignore[no-untyped-def]
    tau, q, ideal, law, weight, d, small, long, total
):
    """Add the projected Hessian of one corner with the Jacobian small[0] to the lower half of total (d², d²).

    law is (weight of the shape, h1, h2, weight of the rank-one term, its slope).
    """
    z, u, v, matrix, vectors = small[0], small[1], small[2], small[3], small[4]
    alike, crossed, part, turned = small[5], small[6], small[7], small[8]
    s, values = long[0], long[1]
    if d == 3:
        _signed_svd_3(z, u, s, v, matrix)
    elif d == 2:
        _signed_svd_2(z, u, s, v)
    else:
        u[0, 0], v[0, 0], s[0] = 1.0, 1.0, tau
    _stretch_matrix(s, q, law, d, matrix)
    _project(matrix, d, vectors, values)
    _pair_modes(s, q, law[0], law[1], d, alike, crossed)
    _product(ideal, v, d, z)  # the right singular vectors at the edges
    for j in range(d):
        for c in range(j + 1):
            _edge_part(z, j, c, matrix, alike, crossed, d, part)
            _product(u, part, d, turned)
            for a in range(d):
                for b in range(d):
                    t = 0.0
                    for k in range(d):
                        t += turned[a, k] * u[b, k]
                    total[j * d + a, c * d + b] += weight * t


@njit(cache=True, error_model="numpy", forceinline=True)
def _edge_part(z, j, c, matrix, alike, crossed, d, out):  # type: ignore[no-untyped-def]
    """out (d, d) = the Hessian between the edges j and c, in the basis of the left singular vectors."""
    for i in range(d):
        diagonal = z[j, i] * z[c, i] * matrix[i, i]
        for k in range(d):
            if k != i:
                diagonal += z[j, k] * z[c, k] * alike[i, k]
                out[i, k] = z[j, i] * z[c, k] * matrix[i, k] + z[j, k] * z[c, i] * crossed[i, k]
        out[i, i] = diagonal
