"""The support radius that is used where none is chosen.

The rule is ``R = min(2.5 L, 2·10⁴ h)``: L the longest side of the mesh's bounding box, h the spacing of the control
points where they are close.

- 2.5 L makes the support global: in one large step the more robust choice (thesis Table 5.6, slab moved by
  (−0.2, −0.2) and rotated by 60°: minimum size −0.49 with R = 0.5 L, 0.03 with 2.5 L), and the radius of the global
  reference solutions in the literature.
- The smallest eigenvalue of the matrix of a C2 function falls as (h/R)³, whatever the dimension; past R ≈ 5·10⁴ h it
  is lost in rounding (2000 points on an ellipse with h = 2·10⁻⁴: a residual of 7·10⁻¹⁴ at R = 10, singular at 25). So
  far fields hundreds of bodies away do not enlarge R for ever. One close pair alone does not do that harm (it costs
  (h/R)² once), therefore h is the fifth percentile of the distances to the nearest neighbour, not their minimum.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mesh_motion_server.numerics.roles import BoundaryRoles

__all__ = ["suggest_support_radius"]

_DOMAIN_LENGTHS = 2.5
_SPACINGS = 2.0e4
_CLOSE = 5.0  # percentile of the distances between neighbours that stands for the close ones


def suggest_support_radius(points: NDArray[np.float64], roles: BoundaryRoles) -> float:
    """Support radius for a mesh.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    roles : BoundaryRoles

    Returns
    -------
    float, mesh length unit
        Rounded to two digits, so that it reads well in a case file and does not depend on rounding.
    """
    radius = _DOMAIN_LENGTHS * float(np.ptp(points, axis=0).max())
    control = points[roles.all]
    if len(control) > 1:
        distance = cKDTree(control).query(control, k=2)[0][:, 1]
        radius = min(radius, _SPACINGS * float(np.percentile(distance, _CLOSE, method="lower")))
    return float(f"{radius:.2g}")
