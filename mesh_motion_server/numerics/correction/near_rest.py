"""The default's second aim: small meshes are raised beyond the threshold, towards the shape of their cells at rest.

The threshold says which mesh is bad. The cells of a mesh above it may still lean more than necessary. If all its nodes
can be freed in about two seconds, the smallest relative skew is raised to :data:`NEAR_REST`, or as near as possible.
Nodes near the moving walls keep their interpolated positions: first cells keep their height and direction.

If displacements count from the committed mesh and NEAR_REST cannot be reached, every step would pay for the attempt. So
the skews below NEAR_REST form a ladder, and a step is raised only if its smallest relative skew falls to a lower rung
than that of the mesh from which it starts.

A flow solver takes every displacement of a node for a velocity. So no node moves further in a step than
:data:`_FURTHEST` times the boundary: a large step is raised, a short time step of a coupled run is left as it is.
"""

import math
from dataclasses import replace

import numpy as np

from mesh_motion_server.numerics.arrays import Floats
from mesh_motion_server.numerics.correction.correction_problem import CorrectionProblem
from mesh_motion_server.numerics.correction.free_region import cells_of_nodes
from mesh_motion_server.numerics.correction.part_of_mesh import Elsewhere
from mesh_motion_server.numerics.correction.trial_nodes import (
    RELATIVE_BOTH,
    RELATIVE_SHAPE,
    Polished,
    TrialMesh,
    polish,
    reach,
)
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.quality.metrics import CellQuality

__all__ = ["NEAR_REST", "NOTICED", "leans", "nearer_rest", "raises", "reshaped", "spoils"]

#: Smallest relative skew that needs no correction.
NEAR_REST = 0.95
#: Free nodes, by dimension, of the largest mesh that is raised: of a mesh above the threshold it takes two seconds.
_LARGEST = {2: 30_000, 3: 20_000}
#: A quality change by less than this factor does not count.
NOTICED = 1.01
_RUNG = 0.9  # between rungs of the ladder below NEAR_REST: successive steps may lose this before one is raised again
_LEAST = 1e-3
#: Largest displacement of a raised node in a step, as a multiple of the boundary's largest.
_FURTHEST = 1.5
#: Least share of the best metric that a mesh below the threshold keeps when it is moved towards its shape at rest.
_WORTH = 0.92


def raises(problem: CorrectionProblem, method: Method) -> bool:
    """Whether the method and the mesh are such that the mesh is raised beyond the threshold."""
    dimension = problem.start.shape[1]
    default = method.correction == "optimised" and method.correction_target == "auto"
    relative = method.quality_metric == "relative-size-skew" and dimension > 1
    return default and relative and int(np.count_nonzero(~problem.held)) <= _LARGEST[dimension]


def leans(problem: CorrectionProblem, mesh: TrialMesh, quality: CellQuality) -> bool:
    """Whether a step that ends with this quality lowers the smallest relative skew to a lower rung."""
    rung = _rung(quality)
    return rung > 0 and rung > _rung(mesh.cell_quality(problem.start))


def _rung(quality: CellQuality) -> int:
    """The rung: 0 from :data:`NEAR_REST` up, below it 1, 2, …"""
    least = max(quality.relative_extremes()[0], _LEAST)
    return max(0, math.ceil(math.log(least / NEAR_REST) / math.log(_RUNG)))


def nearer_rest(problem: CorrectionProblem, mesh: TrialMesh, before: CellQuality) -> Polished:
    """A mesh above the threshold, raised towards its shape at rest; unchanged if that spoils more than it gains."""
    kept = np.zeros_like(mesh.held) if problem.near_walls is None else problem.near_walls()
    kept = kept if mesh.constraint is None else mesh.constraint.closed(kept)
    least, lowest = before.relative_extremes()[0], before.metric(mesh.metric).min()
    held = mesh.held | kept
    # no node of these cells is free: what they have is the most that the whole mesh can reach
    limit = np.min(before.relative_shape, where=~cells_of_nodes(mesh.cells, ~held), initial=NEAR_REST)
    for metric in (RELATIVE_SHAPE, mesh.metric, RELATIVE_BOTH) if limit > NOTICED * least else ():
        found = reach(problem.begin, replace(mesh, held=held, metric=metric), NEAR_REST)
        if _jumps(problem, found.points):
            break
        after = mesh.cell_quality(found.points)
        gains = after.relative_extremes()[0] > NOTICED * least
        if gains and NOTICED * after.metric(mesh.metric).min() > lowest and not spoils(before, after, mesh.metric):
            return found
    return Polished(problem.begin, least)


def _jumps(problem: CorrectionProblem, points: Floats) -> bool:
    """Whether a node moves too far in this step, and further than the interpolation moves any."""
    plain, raised = (np.sum((to - problem.committed) ** 2, axis=1) for to in (problem.begin, points))
    most = max(_FURTHEST**2 * plain[problem.held].max(initial=0.0), plain.max(initial=0.0))
    return bool(raised.max(initial=0.0) > most)


def reshaped(problem: CorrectionProblem, mesh: TrialMesh) -> Polished:
    """A mesh below the threshold at its best metric, or nearer to its shape at rest if that costs little quality."""
    region = mesh.free(~mesh.held)
    best = polish(problem.begin, mesh, region)
    if not best.minimum > 0.0:
        return best  # another metric untangles no more
    shaped = polish(problem.begin, replace(mesh, metric=RELATIVE_SHAPE), region, target=NEAR_REST)
    own, most = (mesh.quality(found.points).min() for found in (shaped, best))
    return shaped if own >= _WORTH * most else best


def spoils(
    before: CellQuality, after: CellQuality, metric: str, gain: float = 1.0, elsewhere: Elsewhere | None = None
) -> bool:
    """Whether the smallest relative skew or size falls by more than the factor ``gain``."""
    if metric != "relative-size-skew":
        return False
    others = (math.inf, math.inf) if elsewhere is None else elsewhere.extremes
    extremes = zip(before.relative_extremes(), after.relative_extremes(), others, strict=True)
    return any(min(own, other) > max(gain, NOTICED) * min(new, other) for own, new, other in extremes)
