"""The support radius and the enrichment radius that are used where none is chosen.

The rule is ``R = min(2.5 L, 2·10⁴ h)``: L the longest side of the mesh's bounding box, h the spacing of the control
points where they are close.

- 2.5 L makes the support global: in one large step the more robust choice (thesis Table 5.6, slab moved by
  (−0.2, −0.2) and rotated by 60°: minimum size −0.49 with R = 0.5 L, 0.03 with 2.5 L), and the radius of the global
  reference solutions in the literature.
- The smallest eigenvalue of the matrix of a C2 function falls as (h/R)³, whatever the dimension; past R ≈ 5·10⁴ h it
  is lost in rounding (2000 points on an ellipse with h = 2·10⁻⁴: a residual of 7·10⁻¹⁴ at R = 10, singular at 25). So
  far fields hundreds of bodies away do not enlarge R for ever. One close pair alone does not do that harm (it costs
  (h/R)² once), therefore h is the fifth percentile of the distances to the nearest neighbour, not their minimum.

The enrichment radius is ``R_l = min(R, 2 H)``, H the largest distance of a node from its nearest control point: so 2 H
is the diameter of the largest ball between the boundaries, about the range over which a wall's compensation lets an
enrichment act. With R_l = R = 2.5 L, one enrichment point bends the whole field: the explicit iterations then reached
0.42 of the best minimum quality over R_l on 11 motions that need them, and 0.93 with 2 H (docs/beyond.md, Defaults).

Both depend on the mesh and not on the motion: the factorization serves every coupling iteration and every step.

What is best for one motion of a mesh is not for another: bodies that are pressed together and a body in a narrow
channel want a radius near the width of the gap, which ruins large motions of the same bodies. So there are candidates
too, for a choice by the motion (:mod:`.radius_choice`): 0.625, 1 and 1.75 diameters of that ball, besides R.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mesh_motion_server.numerics.centres import bounding_box
from mesh_motion_server.numerics.roles import BoundaryRoles
from mesh_motion_server.numerics.spacing import local_spacing

__all__ = ["candidate_support_radii", "suggest_enrichment_radius", "suggest_support_radius"]

_DOMAIN_LENGTHS = 2.5
_SPACINGS = 2.0e4
_CLOSE = 5.0  # percentile of the distances between neighbours that stands for the close ones
_CANDIDATES = (0.625, 1.0, 1.75)  # diameters of the largest ball; R is far above them unless rounding bounds it
_SAMPLE = 20_000  # nodes that the largest ball is looked for at
_EACH = 16  # of these each so many is looked at first
_ROUNDING = 1e-9


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
    radius = _DOMAIN_LENGTHS * float(np.ptp(bounding_box(points), axis=0).max())
    control = points[roles.all]
    if len(control) > 1:
        close = np.percentile(local_spacing(control), _CLOSE, method="lower")
        radius = min(radius, _SPACINGS * float(close))
    return float(f"{radius:.2g}")


def suggest_enrichment_radius(points: NDArray[np.float64], roles: BoundaryRoles, support_radius: float) -> float:
    """Enrichment radius R_l for a mesh.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    roles : BoundaryRoles
    support_radius : float, mesh length unit
        R: R_l is no larger, and equal to it where no node lies off the boundary.

    Returns
    -------
    float, mesh length unit
        Rounded to two digits.
    """
    widest = _widest_ball(points, roles)
    return min(support_radius, float(f"{widest:.2g}")) if widest > 0.0 else support_radius


def candidate_support_radii(
    points: NDArray[np.float64], roles: BoundaryRoles, support_radius: float
) -> tuple[float, ...]:
    """Radii that may be better than ``support_radius`` for a motion of this mesh, descending; all smaller than it.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    roles : BoundaryRoles
    support_radius : float, mesh length unit
        What :func:`suggest_support_radius` says.

    Returns
    -------
    tuple of float, mesh length unit
        Rounded to two digits.
    """
    widest = _widest_ball(points, roles)
    rounded = {float(f"{share * widest:.2g}") for share in _CANDIDATES}
    return tuple(sorted((r for r in rounded if 0.0 < r < support_radius), reverse=True))


def _widest_ball(points: NDArray[np.float64], roles: BoundaryRoles) -> float:
    """Diameter of the largest ball about a node (of a sample) that no control point lies in; 0: all are controls.

    From one node to another the distance to the nearest control point grows by no more than their distance: a node
    whose neighbour in the sample is nearer by more than that to a control point need not be looked at.
    """
    sample = points[:: max(len(points) // _SAMPLE, 1)]
    tree = cKDTree(points[roles.all])
    known = np.repeat(np.arange(0, len(sample), _EACH), _EACH)[: len(sample)]
    distance = tree.query(sample[::_EACH])[0]
    widest = float(distance.max())
    bound = distance[known // _EACH] + np.sqrt(np.sum((sample - sample[known]) ** 2, axis=1))
    left = sample[bound >= (1 - _ROUNDING) * widest]
    return 2.0 * max(widest, float(tree.query(left)[0].max(initial=0.0)))
