"""The default support radius and enrichment radius.

The rule is ``R = 2.5 min(L, 20 B)``: L the longest side of the bounding box of the mesh, B that of all moving nodes.

- 2.5 L makes the support global: in one large step the more robust choice (thesis Table 5.6, slab moved by
  (−0.2, −0.2) and rotated by 60°: minimum size −0.49 with R = 0.5 L, 0.03 with 2.5 L), and the radius of the global
  reference solutions in the literature.
- A far field that is hundreds of body lengths away is not included: the surroundings of the body move nearly like the
  body in either case. The weights grow as (R/h)³, and with them the rounding errors: beyond 50 B there is no gain.

In a domain longer than 10 B, the default motion and interpolation alone have R = 10 B and the multiscale basis. With
the radius above, some nodes move up to 11 times as fast as a body that turns, 1 B or 20 B from a wall; with 10 B up to
twice as fast, and with 16 B up to 2.5 times. When a body turns by 45° the cells keep 0.01 to 0.02 more of their shape
with 16 B, and 0.04 to 0.06 less with Wendland's C2 function and the 6 B that make it as fast. Other compact functions
have 6 B.

If all fixed nodes are far away, at a distance D of at least 5 B from the middle of the moving nodes' box, a small
radius is bad for shifts. So the mean displacement has its own, R_t = 1.6 D (:mod:`.far_field`). If a cylinder is
shifted by a diameter in a circle of 5 to 40 diameters, the shape of its cells is the same to 0.02 for R_t from 1.4 D to
1.8 D as with the large radius for all.

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

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.interpolation.kernels import DEFAULT_BASIS, MULTISCALE, basis_named
from mesh_motion_numerics.mesh.periodic_nodes import PeriodicNodes
from mesh_motion_numerics.mesh.points import bounding_box
from mesh_motion_numerics.mesh.roles import BoundaryRoles
from mesh_motion_numerics.method import Method

__all__ = ["Reach", "suggest_enrichment_radius", "suggest_support_radius", "widest_ball", "with_reach"]

_DOMAIN_LENGTHS, _BODIES = 2.5, 20.0
#: Least L of a large domain, least D of a far field, and R in both with the multiscale basis, in B; R_t in D.
_LARGE, _FAR, _NEAR, _MEAN = 10.0, 5.0, 10.0, 1.6
#: R of other compact functions, in that of the multiscale basis.
_OTHER = 0.6
#: λ, and λ in a far field with layers that move with their walls. Noise of the boundary reaches the nodes of a wing 8
#: times as large with 1e-6, 17 times without, and its cells keep their shape to 0.1 %; around aerofoils with layers 9
#: and 17 times with 1e-3, hundreds of times without. Near a wall without such layers the first cells of an aerofoil
#: that turns by 45° lean over by 11° with 1e-3, by 1.7° with 1e-6, and by 1.4° without; prisms lose 3 % of their shape
#: with 1e-6, half of it with 1e-5.
_SMOOTH, _SMOOTH_LAYER = 1e-6, 1e-3
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
    extent, body = _longest_side(points), _longest_side(points[roles.moving]) if len(roles.moving) else 0.0
    radius = _DOMAIN_LENGTHS * (min(extent, _BODIES * body) if body > 0.0 else extent)
    return float(f"{radius:.2g}")


class Reach(NamedTuple):
    """How the displacement of the boundary reaches into the mesh, besides the basis and the support radius.

    Attributes
    ----------
    mean_radius : float, mesh length unit
        R_t of :mod:`.far_field`; 0 if the mean displacement is not separated.
    smoothing, layer_smoothing : float
        λ of :mod:`.two_scale.factorization`, and the same if layers move with their walls.
    """

    mean_radius: float = 0.0
    smoothing: float = 0.0
    layer_smoothing: float = 0.0


def with_reach(
    method: Method, points: Floats, roles: BoundaryRoles, *, periodic: PeriodicNodes | None
) -> tuple[Method, Reach]:
    """The method with its basis and radii for a mesh, and its reach.

    A support radius that the method names is kept, with its basis and no other radius.

    Only the default motion and interpolation alone have small radii in large domains. Only the default motion is
    smoothed.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    periodic : PeriodicNodes or None
        Those of a mesh with periodic patches: then the body has images.

    Raises
    ------
    InvalidInput
        If the support reaches around the axis of an :class:`.OpenSector`.
    """
    basis, radius, mean_radius = method.basis, method.support_radius, 0.0
    alone = method.correction in ("none", "smooth") and method.reduction == "none" and periodic is None
    smoothing = _SMOOTH if alone and method.correction == "smooth" else 0.0
    if alone:
        body = _longest_side(points[roles.moving])
        if radius is None and basis_named(basis).compact and body > 0.0 and len(roles.fixed):
            middle = bounding_box(points[roles.moving]).mean(axis=0)
            away = float(np.linalg.norm(points[roles.fixed] - middle, axis=1).min())
            far = away >= _FAR * body
            if far or _longest_side(points) > _LARGE * body:
                if basis == DEFAULT_BASIS:
                    basis = MULTISCALE
                radius = float(f"{_NEAR * body * (1.0 if basis == MULTISCALE else _OTHER):.2g}")
            if far:
                mean_radius = float(f"{_MEAN * away:.2g}")
    sector = None if periodic is None else periodic.open_sector
    if radius is None:
        radius = suggest_support_radius(points, roles)
        radius = radius if sector is None else min(radius, sector.suggested_radius)
    if sector is not None:
        sector.check(radius)
    reach = Reach(mean_radius, smoothing, _SMOOTH_LAYER if smoothing and mean_radius else smoothing)
    enrichment = method.enrichment_radius or suggest_enrichment_radius(points, roles, radius)
    return replace(method, basis=basis, support_radius=radius, enrichment_radius=enrichment), reach


def _longest_side(points: Floats) -> float:
    """The longest side of the bounding box of points (n, d)."""
    return float(np.ptp(bounding_box(points), axis=0).max())


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
