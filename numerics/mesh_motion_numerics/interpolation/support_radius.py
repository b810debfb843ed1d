"""The default support radius and enrichment radius.

The rule is ``R = 2.5 min(L, 20 B)``: L the longest side of the bounding box of the mesh, B that of all moving nodes.

- 2.5 L makes the support global: in one large step the more robust choice (thesis Table 5.6, slab moved by
  (−0.2, −0.2) and rotated by 60°: minimum size −0.49 with R = 0.5 L, 0.03 with 2.5 L), and the radius of the global
  reference solutions in the literature.
- A far field that is hundreds of body lengths away is not included: the surroundings of the body move nearly like the
  body in either case. The weights grow as (R/h)³, and with them the rounding errors: beyond 50 B there is no gain.

In a domain longer than 3.5 B, the default motion and interpolation alone have R = 10 B and the multiscale basis in
place of Wendland's C2 function. With the radius above, some nodes move up to 11 times as fast as a body that turns, 1 B
or 20 B from a wall, and 2.2 times in domains of 4 to 6 B; with 10 B up to twice as fast, and with 16 B up to 2.5 times.
When a body turns by 45° the cells keep 0.01 to 0.02 more of their shape with 16 B, and 0.04 to 0.06 less with
Wendland's C2 function and the 6 B that make it as fast. In smaller domains both are as good, and the sum of four scales
costs more.

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
from mesh_motion_numerics.interpolation.kernels import DEFAULT_BASIS, MULTISCALE
from mesh_motion_numerics.interpolation.two_scale.smoothing import Smoothing
from mesh_motion_numerics.mesh.neighbours import local_spacing
from mesh_motion_numerics.mesh.periodic_nodes import PeriodicNodes
from mesh_motion_numerics.mesh.points import bounding_box
from mesh_motion_numerics.mesh.roles import BoundaryRoles
from mesh_motion_numerics.method import Method

_DOMAIN_LENGTHS, _BODIES = 2.5, 20.0
#: Least L of a large domain, least D of a far field, and R in both with the multiscale basis, in B; R_t in D.
_LARGE, _FAR, _NEAR, _MEAN = 3.5, 5.0, 10.0, 1.6
#: Shortest wave of the boundary that the first level follows, in B (in 3D in the second side, as the longest may be the
#: span), and the radii of the narrow levels in spacings: by dimension without layers that move with their walls, and
#: with them. Noise of the boundary reaches the nodes of 31 meshes up to 10 times as large, without smoothing up to
#: hundreds of times. With a shorter wave or wider levels the noise grows: 15 times with 16 spacings. With a longer wave
#: or narrower levels, first cells turn: at the sharp edges of aerofoils that turn by 45° by 1.9° to 3.5° (1.6° to 1.7°
#: without smoothing), with 0.15 B and 6 spacings by up to 5°. First cells of a layer that moves with its wall do not
#: turn; but levels continue the noise of a thin trailing edge into the wake, 15 times with 16 spacings, 8 with 6.
_SMOOTH, _SMOOTH_LAYER = {1: (0.125, 10.0), 2: (0.125, 10.0), 3: (0.2, 16.0)}, (0.3, 6.0)
#: The wave is at least this number of spacings, as a coarse wall has no shorter waves, but at most this share of the
#: body; three quarters of the moving nodes do not exceed the spacing. Noise of a tower of 0.4 x 0.4 x 1.5 with a
#: spacing of 0.09 then grows 7 instead of 13 times. With a whole body, a cube of four cells along an edge loses
#: quality: 0.55 instead of 0.60 at 30 degrees.
_SPACINGS, _SHARE = 3.0, 0.5
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
    """How the displacement of the boundary reaches into the mesh, besides the basis and the support radius."""

    mean_radius: float = 0.0  # mesh length unit. R_t of :mod:`.far_field`; 0 if the mean displacement is not separated
    #: smoothing, layer_smoothing: Of the first level, and the same if layers move with their walls; None: the first
    #: level is exact.
    smoothing: Smoothing | None = None
    layer_smoothing: Smoothing | None = None


def with_reach(
    method: Method, points: Floats, roles: BoundaryRoles, *, periodic: PeriodicNodes | None
) -> tuple[Method, Reach]:
    """The method with its basis and radii for a mesh, and its reach.

    A support radius that the method names is kept, with its basis and no other radius.

    Only the default motion and interpolation alone have the multiscale basis. Only the default motion is smoothed.

    Raises InvalidInput if the support reaches around the axis of an :class:`.OpenSector`.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    periodic : PeriodicNodes or None
        Those of a mesh with periodic patches: then the body has images, and Wendland's C2 function.
    """
    basis, radius, mean_radius = method.basis, method.support_radius, 0.0
    alone = method.correction in ("none", "smooth") and method.reduction == "none"
    smoothing = []
    box = bounding_box(points[roles.moving]) if len(roles.moving) else np.zeros((2, points.shape[1]))
    sides = np.sort(np.ptp(box, axis=0))
    body = float(sides[-1])
    if alone and body > 0.0:
        if method.correction == "smooth":
            section = float(sides[1]) if len(sides) > 2 else body
            pairs = [_SMOOTH[len(sides)]]
            if periodic is None or not np.isin(roles.moving, periodic.members).any():
                pairs.append(_SMOOTH_LAYER)  # otherwise thin cells at a periodic side, which no layer moves, need all
            spacing = float(np.quantile(local_spacing(points[roles.moving]), 0.75))
            shortest = min(_SPACINGS * spacing, _SHARE * section)
            smoothing = [Smoothing(max(wave * section, shortest), radii) for wave, radii in pairs]
        away = float(np.linalg.norm(points[roles.fixed] - box.mean(axis=0), axis=1).min(initial=np.inf))
        far = _FAR * body <= away < np.inf
        large = periodic is None and (far or _longest_side(points) > _LARGE * body)
        if large and radius is None and basis in (DEFAULT_BASIS, MULTISCALE):
            basis, radius = MULTISCALE, float(f"{_NEAR * body:.2g}")
            mean_radius = float(f"{_MEAN * away:.2g}") if far else 0.0
    sector = None if periodic is None else periodic.open_sector
    if radius is None:
        radius = suggest_support_radius(points, roles)
        radius = radius if sector is None else min(radius, sector.suggested_radius)
    if sector is not None:
        sector.check(radius)
    reach = Reach(mean_radius, *smoothing)
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
