"""The deformation B = I + J of a cell, its eigenvalues, and its singular values and nearest rotation (thesis §5.2).

J = ∇S is the gradient of the displacement at the cell, so ``A_new = B A`` for its corner Jacobians: thesis (5.7).

A cell is inverted when det B ≤ 0. Textbook decompositions then hide a reflection in their orthogonal matrices (5.12);
here these are always *rotations*, det = +1, and the reflection shows as a negative stretch, the smallest one.

References
----------
G. Irving, J. Teran, R. Fedkiw, Invertible finite elements for robust simulation of large deformation, SCA 2004 (signed
singular values).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats

_CANCELLED = 1e-12  # sum of two stretches, in units of the largest, below which it counts as zero


class Eigen(NamedTuple):
    """``B = V diag(values) V⁻¹``."""

    #: (m, d). Ascending by real part; a complex pair with the negative imaginary part first.
    values: NDArray[np.complex128]
    vectors: NDArray[np.complex128]  # (m, d, d). Unit columns V; nearly parallel ones where B is a pure shear


class SVD(NamedTuple):
    """``B = left @ diag(stretches) @ right.T`` of each matrix."""

    #: left, right: (m, d, d). Rotations, det = +1.
    left: Floats
    stretches: Floats  # (m, d). Descending in magnitude, all positive but the last, which is negative where B reflects
    right: Floats


def deformation(gradient: Floats) -> Floats:
    """B = I + J of displacement gradients (…, d, d), thesis (5.7)."""
    return np.asarray(gradient + np.eye(gradient.shape[-1]))


def eigen(B: Floats) -> Eigen:
    """Eigenvalues and eigenvectors of B (m, d, d), thesis (5.13)."""
    values, vectors = (part.astype(np.complex128) for part in np.linalg.eig(B))  # pairs are exact conjugates
    order = np.lexsort((values.imag, values.real), axis=-1)
    return Eigen(np.take_along_axis(values, order, -1), np.take_along_axis(vectors, order[:, None, :], -1))


def svd(B: Floats) -> SVD:
    """Signed singular value decomposition of B (m, d, d), thesis (5.8)."""
    left, stretches, right_t = np.linalg.svd(B)
    right = np.swapaxes(right_t, -1, -2)
    flip_left, flip_right = determinant_signs(left), determinant_signs(right)
    left[:, :, -1] *= flip_left[:, None]
    right[:, :, -1] *= flip_right[:, None]
    stretches[:, -1] *= flip_left * flip_right
    return SVD(left, stretches, right)


def nearest_rotation(B: Floats) -> Floats:
    """(m, d, d) the rotation nearest to each B (m, d, d), as in thesis (5.11); of several equally near ones, one."""
    left, _, right = svd(B)
    return np.asarray(left @ np.swapaxes(right, -1, -2))


def nearest_rotation_slope(B: Floats) -> Floats:
    """(m, d, d, d, d) derivatives ``[i, a, b, c, e] = ∂R_ab/∂B_ce`` of the nearest rotations R of B (m, d, d).

    With ``B = U S Vᵀ`` the derivative is ``dR = U K Vᵀ``, where K is Uᵀ dB V minus its transpose, divided by the sums
    of two stretches. If such a sum is 0, the rotation is not determined, and the entry of K is 0.
    """
    left, stretches, right = svd(B)
    sums = stretches[:, :, None] + stretches[:, None, :]
    clear = np.abs(sums) > _CANCELLED * np.abs(stretches).max(axis=1, initial=0.0)[:, None, None]
    inverse = np.divide(1.0, sums, out=np.zeros_like(sums), where=clear)
    scaled = np.einsum("mai,mbj,mij->mabij", left, right, inverse)
    first = np.einsum("mabij,mci,mej->mabce", scaled, left, right)
    return np.asarray(first - np.einsum("mabij,mcj,mei->mabce", scaled, left, right))


def determinant_signs(orthogonal: Floats) -> Floats:
    """Determinants (m,) of orthogonal matrices, rounded to ±1."""
    return np.where(np.linalg.det(orthogonal) < 0.0, -1.0, 1.0)
