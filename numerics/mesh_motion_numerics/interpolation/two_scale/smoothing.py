"""How the first level of a boundary's interpolation leaves short waves of the boundary to the narrow levels.

An interpolation that is exact at all nodes takes a difference of two close nodes for a slope, and continues it into the
mesh over the support radius. So the first level minimises ``|s|² + Σ (s(x_j) − u_j)² / λ_j`` in the norm of the basis.
On a wall with n nodes per length (per area in 3D) the matrix multiplies a wave of wave number k by n Φ(k), with the
Fourier transform Φ of the basis on the wall; with λ_j equal to this, a wave is damped to a half, shorter ones more. The
wave that is halved is a length of the body, and so the result does not depend on the mesh.

References
----------
H. Wendland, *Scattered Data Approximation*, Cambridge 2005, §5 (Fourier transforms of radial functions), §19.3
(smoothing splines).
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import j0

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.interpolation.kernels import Basis, values

#: Least number of panels of a Gauss rule from 0 to R, and its points in a panel, which has at most one wave. The panels
#: end where functions of several scales have their kinks.
_PANELS, _POINTS = 64, 24


class Smoothing(NamedTuple):
    """The waves that the first level follows, and the levels for the remainder."""

    wave: float  # mesh length unit. Wavelength at the wall that the first level damps to a half
    radii: float  # Support radius of a narrow level in units of the spacing of its nodes

    def shares(self, basis: Basis, radius: float, points: Floats, spacing: Floats) -> Floats:
        """λ (m,) of control points (m, d) with the distance ``spacing`` (m,) from their nearest neighbours."""
        panels = _PANELS * math.ceil(radius / self.wave / _PANELS)
        nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
        xi = ((np.arange(panels)[:, None] + (nodes + 1.0) / 2.0) / panels).ravel()
        phase, solid = 2.0 * np.pi * radius / self.wave * xi, points.shape[1] > 2
        around = 2.0 * np.pi * radius**2 * xi * j0(phase) if solid else 2.0 * radius * np.cos(phase)
        transform = float(np.tile(weights / (2.0 * panels), panels) @ (values(basis, xi) * around))
        near = np.maximum(self.wave / 2.0, spacing)
        count = cKDTree(points).query_ball_point(points, near * (1.0 - 1e-9), return_length=True)
        return np.asarray(max(transform, 0.0) * count / (np.pi * near**2 if solid else 2.0 * near))
