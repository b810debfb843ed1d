"""Enclosing box: only nodes inside a box around the moving body move, with zero displacement on its surface.

The surface is sampled with control points that stay, and the field is interpolated again from them, the body and all
other boundary nodes in the box: so it falls to zero as smoothly as at a wall (the standard field blended to zero in the
same box gave half of the minimum quality and less, for tight boxes). The small rest between the samples is faded out
over the last tenth of the margin, and nodes outside do not move at all.

The margin is chosen from the motion and the body, five largest displacements or one body size, rounded up to a power
of √2: so that the box, and with it the factorization, stays the same while a coupling step iterates.

References
----------
Thesis §2.2.1.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from docs.studies.thesis._volume_reduction.problem import (
    Field,
    VolumeDisplacement,
    VolumeField,
    VolumeProblem,
)
from docs.studies.thesis._volume_reduction.wall_function import restriction

__all__ = ["BoxField", "box_surface", "reduce"]

Floats = NDArray[np.float64]

_DISPLACEMENTS, _BODIES = 5.0, 1.0
#: Intervals along an edge of the box, by dimension; twice as many change the minimum quality by less than 0.005.
_INTERVALS = {1: 1, 2: 12, 3: 7}
#: Share of the margin over which the rest at the surface is faded out.
_FADE = 0.1


@dataclass(frozen=True, eq=False)
class BoxField:
    """The field of a box.

    Attributes
    ----------
    low, high : (d,) arrays, mesh length unit
    fade : float, mesh length unit
        Depth below the surface beyond which nothing is faded out.
    inner : callable
        The interpolated field inside the box.
    """

    low: Floats
    high: Floats
    fade: float
    inner: Field
    control_points: int

    def __call__(self, points: Floats) -> VolumeDisplacement:
        """Displacement of points (n, d); exactly zero on and outside the box."""
        depth = np.minimum(points - self.low, self.high - points).min(axis=1)
        inside = depth > 0.0
        out = np.zeros_like(points)
        share = 1.0 - restriction(depth[inside] / self.fade)
        out[inside] = share[:, None] * self.inner(points[inside])
        return VolumeDisplacement(out, inside, int(np.count_nonzero(inside)), self.control_points)


def reduce(problem: VolumeProblem) -> VolumeField:
    """Interpolate from the body, the box and the boundary nodes in it."""
    margin = problem.length or _rounded_up(problem.reach(_DISPLACEMENTS, _BODIES))
    body = problem.boundary[problem.moving]
    low, high = body.min(axis=0) - margin, body.max(axis=0) + margin
    kept = ((problem.boundary > low) & (problem.boundary < high)).all(axis=1)
    surface = box_surface(low, high, _INTERVALS[body.shape[1]])
    spacing = float(np.max(high - low)) / _INTERVALS[body.shape[1]]
    # a wall that the box cuts has its own control points there
    distinct = cKDTree(problem.boundary[kept]).query(surface)[0] > 0.25 * spacing
    control = np.vstack([problem.boundary[kept], surface[distinct]])
    values = np.vstack([problem.displacement[kept], np.zeros_like(surface[distinct])])
    return BoxField(low, high, _FADE * margin, problem.interpolate(control, values), len(control))


def _rounded_up(length: float) -> float:
    """The next power of √2."""
    return float(2.0 ** (math.ceil(2.0 * math.log2(length)) / 2.0))


def box_surface(low: Floats, high: Floats, intervals: int) -> Floats:
    """(s, d) lattice points on the surface of a box, each once."""
    axes = [np.linspace(a, b, intervals + 1) for a, b in zip(low, high, strict=True)]
    lattice = itertools.product(*(range(intervals + 1) for _ in axes))
    on_surface = [place for place in lattice if any(i in {0, intervals} for i in place)]
    return np.array([[axis[i] for axis, i in zip(axes, place, strict=True)] for place in on_surface])
