"""The default support radius and enrichment radius.

The rule is ``R = 2.5 min(L, 20 B)``: L the longest side of the bounding box of the mesh, B that of all moving nodes.

- 2.5 L makes the support global: in one large step the more robust choice (thesis Table 5.6, slab moved by
  (−0.2, −0.2) and rotated by 60°: minimum size −0.49 with R = 0.5 L, 0.03 with 2.5 L), and the radius of the global
  reference solutions in the literature.
- A far field that is hundreds of body lengths away is not included: the surroundings of the body move nearly like the
body in either case. An aerofoil in a C-grid of 1000 chords, turned by 45° and moved by half a chord, keeps a skew of
0.90, 0.93,
  0.93, 0.94 and 0.92 of that at rest with R = 20, 50, 100, 500 and 2500 chords. The weights grow as (R/h)³, and with
  them the rounding errors: beyond 50 B there is no gain.

The spacing does not limit the radius: if rounding forbids one matrix, :mod:`.two_scale` uses two scales.

The enrichment radius is ``R_l = min(R, 2 H)``, H the largest distance of a node from its nearest control point: so 2 H
is the diameter of the largest ball between the boundaries. This is about the range in which an enrichment can act in
spite of the compensation at the walls. With R_l = R = 2.5 L, one enrichment point bends the whole field: on 11 motions
that need them, the explicit iterations then reached 0.42 of the best minimum quality over all R_l, and 0.93 with 2 H
(docs/beyond.md, Defaults).

Both radii depend on the mesh and not on the motion: every coupling iteration and every step uses the same
factorization.

The best radius for one motion of a mesh is not the best for another: for bodies that are pressed together, or a body in
a narrow channel, it is near the width of the gap, but with such a radius large motions of the same bodies fail
(docs/beyond.md).
"""

import numpy as np
from scipy.spatial import cKDTree

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.mesh.points import bounding_box
from mesh_motion_numerics.mesh.roles import BoundaryRoles

__all__ = ["suggest_enrichment_radius", "suggest_support_radius", "widest_ball"]

_DOMAIN_LENGTHS, _BODIES = 2.5, 20.0
_SAMPLE = 20_000  # number of nodes at which the largest ball is searched
_EACH = 16  # every 16th of them is tested first
_ROUNDING = 1e-9


def suggest_support_radius(points: Floats, roles: BoundaryRoles) -> float:
    """Support radius for a mesh.

    Parameters
    ----------
    points : (n, d) array, mesh length unit

    Returns
    -------
    float, mesh length unit
        Rounded to two digits, so that it is readable in a case file and does not depend on rounding errors.
    """
    extent = float(np.ptp(bounding_box(points), axis=0).max())
    body = float(np.ptp(bounding_box(points[roles.moving]), axis=0).max()) if len(roles.moving) else 0.0
    radius = _DOMAIN_LENGTHS * (min(extent, _BODIES * body) if body > 0.0 else extent)
    return float(f"{radius:.2g}")


def suggest_enrichment_radius(points: Floats, roles: BoundaryRoles, support_radius: float) -> float:
    """Enrichment radius R_l for a mesh.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    support_radius : float, mesh length unit
        R: R_l is not larger than R, and equal to R if all nodes are on the boundary.

    Returns
    -------
    float, mesh length unit
        Rounded to two digits.
    """
    widest = widest_ball(points, roles)
    return min(support_radius, float(f"{widest:.2g}")) if widest > 0.0 else support_radius


def widest_ball(points: Floats, roles: BoundaryRoles) -> float:
    """Diameter of the largest ball around a node (of a sample) without a control point; 0 if all are control points.

    From one node to another the distance to the nearest control point grows by no more than their distance. So a node
    is skipped if that bound, from its neighbour in the sample, cannot give a larger ball.
    """
    sample = points[:: max(len(points) // _SAMPLE, 1)]
    tree = cKDTree(points[roles.all])
    known = np.repeat(np.arange(0, len(sample), _EACH), _EACH)[: len(sample)]
    distance = tree.query(sample[::_EACH])[0]
    widest = float(distance.max())
    bound = distance[known // _EACH] + np.sqrt(np.sum((sample - sample[known]) ** 2, axis=1))
    left = sample[bound >= (1 - _ROUNDING) * widest]
    return 2.0 * max(widest, float(tree.query(left)[0].max(initial=0.0)))
