"""Kedward's multiscale interpolation: exact at every boundary node, with storage proportional to their number.

A *base set* is interpolated with the support radius of the motion. Every other node is then added separately, farthest
first. Its function's radius is its separation from all earlier nodes, so that it changes none of them, and its weight
is the remaining error at the node. In that order the matrix is ::

    | φ_base      0 |     a full block for the base set, below it a lower triangle with ones on its
    | φ_(r,base)  L |     diagonal, of which only the entries of near nodes are not zero

so that only the base set must be factorized (thesis §2.2.1, Fig 2.5).

Radii are rounded down to a geometric sequence, :data:`CLASSES` to a factor of two. The nodes of a class are further
apart than its radius: its block of L is the identity, and a class is added at once, as one level, instead of node by
node.

Such narrow functions are steep: their displacements must be small relative to their radius. Kedward also chooses the
base set farthest first, from the geometry alone. If the body is small compared with the domain, most of such a set lies
on the outer wall, the narrow functions must represent too much of the motion, and cells next to the body invert. So
here the base set is chosen for the motion, greedily, down to the tolerance. The tolerance has no other use, because no
error is left at the nodes.

References
----------
L. Kedward, C. B. Allen, T. C. S. Rendall, "Efficient and exact mesh deformation using multiscale RBF interpolation",
J. Comput. Phys. 345 (2017) 732–751; thesis [28].
"""

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.reduction.grouped_circular import default_groups, select
from mesh_motion_numerics.reduction.problem import Progress, Reduced, ReductionProblem

from docs.studies.thesis._point_reduction.farthest_first import farthest_first
from docs.studies.thesis._point_reduction.level_sum import LevelSum

__all__ = ["CLASSES", "class_radii", "greedy_base", "reduce"]


CLASSES = 2.0
"""Radii to a factor of two: each is at least 2^(−1/2) = 0.71 of the separation."""


def greedy_base(problem: ReductionProblem) -> Integers:
    """(n,) nodes with which no error exceeds the tolerance."""
    return select(problem, default_groups(problem.n_points), Progress(problem))


def class_radii(separation: Floats) -> Floats:
    """(n,) radii: separations (n,), not increasing, rounded down to ``separation[0] 2^(−j / CLASSES)``."""
    steps = np.ceil(CLASSES * np.log2(separation[0] / separation))
    radii = separation[0] * 2.0 ** (-steps / CLASSES)
    return np.asarray(np.minimum(radii, separation))  # rounding of the logarithm


def reduce(problem: ReductionProblem, *, base: Callable[[ReductionProblem], Integers] = greedy_base) -> Reduced:
    """Interpolate from a base set, then add all other nodes, one class of radii at a time.

    Parameters
    ----------
    problem : ReductionProblem
        Its ``max_points`` bounds base set and added nodes together.
    base : callable
        Chooses the base set (nc,).

    Raises
    ------
    InvalidInput
        If the basis has no compact support.
    """
    field = LevelSum(problem)
    field.require_compact("multiscale")
    first = base(problem)
    field.add(first, problem.support_radius)
    nodes = farthest_first(problem.points, first)
    rest = slice(len(first), problem.limit)
    for members, radius in _classes(nodes.order[rest], nodes.separation[rest]):
        level = problem.level(members, field.error[members], support_radius=radius)
        field.append(level, members, solve_operations=0.0)
    return field.reduced()


def _classes(order: Integers, separation: Floats) -> Iterator[tuple[Integers, float]]:
    """The nodes in ``order`` (n) by their radii, from coarse to fine."""
    if order.size:
        radii = class_radii(separation)
        bounds = [0, *(np.flatnonzero(np.diff(radii)) + 1), len(order)]
        for first, last in pairwise(bounds):
            yield order[first:last], float(radii[first])
