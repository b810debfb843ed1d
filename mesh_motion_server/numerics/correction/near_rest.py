"""The default's second aim: small meshes are raised beyond the threshold, towards the shape of their cells at rest.

The threshold says which mesh is bad. A mesh above it may still lean much more than it has to, and where all its nodes
can be freed in about a second, the smallest relative skew is raised to :data:`NEAR_REST`, or as near as it comes.
Nodes near the moving walls stay where interpolation put them: first cells keep their height and direction.

With displacements that count from the committed mesh, every step would pay for what cannot be reached. So a step is
raised only where it takes the smallest relative skew to a lower rung of a ladder than that of the mesh it starts from.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mesh_motion_server.numerics.correction.correction_problem import (
    SMALL_MESH,
    CorrectionProblem,
    CorrectionSettings,
)
from mesh_motion_server.numerics.correction.trial_nodes import RELATIVE_SHAPE, Polished, TrialMesh, polish, reach
from mesh_motion_server.numerics.quality.metrics import CellQuality

__all__ = ["NEAR_REST", "NOTICED", "leans", "nearer_rest", "raises", "reshaped", "spoils"]

#: Smallest relative skew that needs no correction.
NEAR_REST = 0.95
#: Factor by which a quality may fall for nothing.
NOTICED = 1.01
_RUNG = 0.9  # of the ladder below NEAR_REST: what one step after the other may lose before it is raised again
_LEAST = 1e-3
#: Of the best metric of a mesh below the threshold, what the shape at rest may cost.
_WORTH = 0.92


def raises(problem: CorrectionProblem, settings: CorrectionSettings) -> bool:
    """Whether the settings and the mesh are those that are raised beyond the threshold."""
    dimension = problem.start.shape[1]
    default = settings.correction == "optimised" and settings.target == "auto" and settings.in_time == "independent"
    relative = settings.quality_metric == "relative-size-skew" and dimension > 1
    return default and relative and int(np.count_nonzero(~problem.held)) <= SMALL_MESH[dimension]


def leans(problem: CorrectionProblem, mesh: TrialMesh, quality: CellQuality) -> bool:
    """Whether a step that ends with this quality takes the smallest relative skew to a lower rung."""
    rung = _rung(quality)
    return rung > 0 and rung > _rung(mesh.cell_quality(problem.start))


def _rung(quality: CellQuality) -> int:
    """0 from :data:`NEAR_REST` up, then 1, 2, …"""
    least = max(quality.relative_extremes()[0], _LEAST)
    return max(0, math.ceil(math.log(least / NEAR_REST) / math.log(_RUNG)))


def nearer_rest(problem: CorrectionProblem, mesh: TrialMesh, before: CellQuality) -> Polished:
    """A mesh above the threshold raised towards its shape at rest; as it was where that spoils more than it gains."""
    kept = np.zeros_like(mesh.held) if problem.near_walls is None else problem.near_walls()
    kept = kept if mesh.constraint is None else mesh.constraint.closed(kept)
    least, lowest = before.relative_extremes()[0], before.metric(mesh.metric).min()
    for metric in (RELATIVE_SHAPE, mesh.metric):
        found = reach(problem.begin, replace(mesh, held=mesh.held | kept, metric=metric), NEAR_REST)
        after = mesh.cell_quality(found.points)
        gains = after.relative_extremes()[0] > NOTICED * least
        if gains and NOTICED * after.metric(mesh.metric).min() > lowest and not spoils(before, after, mesh.metric):
            return found
    return Polished(problem.begin, least)


def reshaped(problem: CorrectionProblem, mesh: TrialMesh) -> Polished:
    """A mesh below the threshold at its best metric, or nearer to its shape at rest where that costs little of it."""
    region = mesh.free(~mesh.held)
    best = polish(problem.begin, mesh, region)
    shaped = polish(problem.begin, replace(mesh, metric=RELATIVE_SHAPE), region, target=NEAR_REST)
    own, most = (mesh.quality(found.points).min() for found in (shaped, best))
    return shaped if own >= _WORTH * most else best


def spoils(before: CellQuality, after: CellQuality, metric: str, gain: float = 1.0) -> bool:
    """Whether the smallest relative skew or size falls by more than the ``gain``, a factor."""
    if metric != "relative-size-skew":
        return False
    extremes = zip(before.relative_extremes(), after.relative_extremes(), strict=True)
    return any(own > max(gain, NOTICED) * new for own, new in extremes)
