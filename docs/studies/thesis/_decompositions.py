"""Decompositions of a cell's deformation B = I + J: eigen, polar, singular value and QR decomposition.

J = ∇S is the gradient of the displacement at the cell, so ``A_new = B A`` for its corner Jacobians: thesis (5.7), §5.2.

=========  ==================  ==================================================================================
function   B =                 what it says
=========  ==================  ==================================================================================
``eigen``  V Λ V⁻¹ (5.13)      factors along the directions that B keeps; a complex pair is a rotation; a real
                               factor ≤ 0 a reversed direction. Says nothing about shear.
``polar``  Q S (5.10)          the nearest rotation Q and the stretch S about principal axes: independent of the
                               coordinates. The most faithful split into "turned" and "deformed".
``svd``    U diag(s) Vᵀ (5.8)  the principal stretches s: s_min / s_max is the loss of shape, their product the size
``qr``     Q R (5.9)           a rotation Q that takes the first edge with it, then stretches (diagonal of R) and
                               shears (the rest). Depends on the choice of coordinates.
=========  ==================  ==================================================================================

A cell is inverted when det B ≤ 0. Textbook decompositions then hide a reflection in Q, U or V (5.12); here these are
always *rotations*, det = +1, and the reflection shows as one negative stretch: the smallest one (``polar``, ``svd``)
or the last one (``qr``). The thesis calls R lower triangular; with edges as columns it is upper triangular, as usual.

The server itself needs ``eigen`` and ``svd``: :mod:`mesh_motion_numerics.decomposition`.

References
----------
K. Shoemake, T. Duff, Matrix animation and polar decomposition, Graphics Interface 1992.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from mesh_motion_numerics.decomposition import deformation, determinant_signs, eigen, nearest_rotation, svd
from numpy.typing import NDArray

__all__ = ["QR", "Polar", "deformation", "eigen", "polar", "qr", "rotation_angle", "svd"]

Floats = NDArray[np.float64]


class Polar(NamedTuple):
    """``B = rotation @ stretch``.

    Attributes
    ----------
    rotation : (m, d, d) array
        The rotation nearest to B, det = +1; of several equally near ones, one.
    stretch : (m, d, d) array
        Symmetric; positive definite unless the cell is inverted, when one eigenvalue is ≤ 0.
    """

    rotation: Floats
    stretch: Floats


class QR(NamedTuple):
    """``B = rotation @ triangle``.

    Attributes
    ----------
    rotation : (m, d, d) array
        det = +1.
    triangle : (m, d, d) array
        Upper triangle; its diagonal is positive except for the last entry, which has the sign of det B.
    """

    rotation: Floats
    triangle: Floats


def polar(B: Floats) -> Polar:
    """The nearest rotation, as (5.11) has it, and the stretch of B (m, d, d), thesis (5.10)."""
    _, stretches, right = svd(B)
    return Polar(nearest_rotation(B), (right * stretches[:, None, :]) @ np.swapaxes(right, -1, -2))


def qr(B: Floats) -> QR:
    """Rotation and upper triangle of B (m, d, d), thesis (5.9)."""
    rotation, triangle = np.linalg.qr(B)
    signs = np.where(np.diagonal(triangle, axis1=-2, axis2=-1) < 0.0, -1.0, 1.0)
    signs[:, -1] = determinant_signs(rotation) * np.prod(signs[:, :-1], axis=-1)  # makes det Q = +1
    return QR(rotation * signs[:, None, :], triangle * signs[:, :, None])


def rotation_angle(rotation: Floats) -> Floats:
    """Angle (m,) in radians of rotations (m, d, d): 2D in (−π, π], anticlockwise; 3D in [0, π], about their axis."""
    if rotation.shape[-1] == 2:
        return np.asarray(np.arctan2(rotation[:, 1, 0] - rotation[:, 0, 1], rotation[:, 0, 0] + rotation[:, 1, 1]))
    skew = rotation - np.swapaxes(rotation, -1, -2)
    sine = 0.5 * np.sqrt(skew[:, 2, 1] ** 2 + skew[:, 0, 2] ** 2 + skew[:, 1, 0] ** 2)
    return np.asarray(np.arctan2(sine, 0.5 * (np.trace(rotation, axis1=-2, axis2=-1) - 1.0)))
