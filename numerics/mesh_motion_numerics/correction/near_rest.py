"""The default's second aim: a small mesh below the threshold is raised towards the shape of its cells at rest.

The best metric alone may be reached at the cost of shapes. Where that costs little quality, the mesh that is nearer to
its shape at rest is taken. A mesh above the threshold is left as the interpolation has it.
"""

import math
from dataclasses import replace

import numpy as np

from mesh_motion_numerics.correction.correction_problem import CorrectionProblem
from mesh_motion_numerics.correction.part_of_mesh import Elsewhere
from mesh_motion_numerics.correction.trial_nodes import (
    RELATIVE_SHAPE,
    Polished,
    TrialMesh,
    polish,
)
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.quality.metrics import CellQuality

__all__ = ["NEAR_REST", "NOTICED", "raises", "reshaped", "spoils"]

#: Smallest relative skew that needs no correction.
NEAR_REST = 0.95
#: Free nodes, by dimension, of the largest mesh that is raised: of a mesh above the threshold it takes two seconds.
_LARGEST = {2: 30_000, 3: 20_000}
#: A quality change by less than this factor does not count.
NOTICED = 1.01
#: Least share of the best metric that a mesh below the threshold keeps when it is moved towards its shape at rest.
_WORTH = 0.92


def raises(problem: CorrectionProblem, method: Method) -> bool:
    """Whether a mesh below the threshold is raised beyond it, towards its shape at rest."""
    dimension = problem.start.shape[1]
    default = method.correction == "optimised" and method.correction_target == "auto"
    relative = method.quality_metric == "relative-size-skew" and dimension > 1
    return default and relative and int(np.count_nonzero(~problem.held)) <= _LARGEST[dimension]


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
