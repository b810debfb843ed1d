"""Sequential linear programmes that raise the minimum quality itself until no further step is found.

Each maximises t so that log q_c + ∇ log q_c · δ ≥ t for every cell c near the worst, with |δ| ≤ Δ; the step is accepted
if the true minimum rises, and Δ grows or shrinks with the accuracy of the linear model. If no t gives an increase,
the positions are stationary: no direction raises all of the worst cells together.
"""

from __future__ import annotations

import math

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.correction.cell_distortion import cell_gradient
from mesh_motion_numerics.correction.distortion import PNorm
from mesh_motion_numerics.correction.free_region import FreeRegion
from mesh_motion_numerics.correction.trial_nodes import region_quality
from mesh_motion_numerics.quality.metrics import sizes_of
from scipy.optimize import linprog
from scipy.sparse import csr_array

__all__ = ["climbed", "shortest"]

_METRIC = PNorm(1, 1e6, of="cells")  # log(1/size-skew), apart from the rounding of |log τ|
_WINDOW, _STEP = 1.35, 0.05  # cells up to so much better than the worst; first Δ, of the shortest reference edge
_PROMISE = 1e-5  # relative: less is not worth a programme


def climbed(points: Floats, region: FreeRegion, metric: str, iterations: int = 25) -> float:
    """The minimum that sequential linear programmes reach from points (n, d)."""
    local = points[region.nodes]
    quality = region_quality(local, region, metric)
    radius = _STEP * shortest(sizes_of(region.reference_sizes), points.shape[1])
    for _ in range(iterations):
        step, promised = _programme(local, quality, region, radius)
        trial = local.copy()
        trial[: region.n_free] += step
        found = region_quality(trial, region, metric)
        gain = math.log(found.min() / quality.min()) if found.min() > 0.0 else -math.inf
        radius *= 2.0 if gain > 0.5 * promised else 0.25 if gain < 0.1 * promised else 1.0
        if gain > 0.0:
            local, quality = trial, found
        if promised < _PROMISE:
            break
    return float(quality.min())


def _programme(local: Floats, quality: Floats, region: FreeRegion, radius: float) -> tuple[Floats, float]:
    """The step (f, d) that raises the linearised minimum most, and the log of its factor."""
    matrix, low = _linearised(local, quality, region)
    used = np.unique(matrix.indices)
    rows = csr_array(np.column_stack([matrix[:, used].toarray(), np.ones(len(low))]))
    found = linprog(
        np.append(np.zeros(len(used)), -1.0),
        A_ub=rows,
        b_ub=low,
        bounds=[*[(-radius, radius)] * len(used), (None, None)],
        method="highs-ipm",
    )
    step = np.zeros(region.n_free * local.shape[1])
    if found.x is None:  # the solver gave up
        return step.reshape(region.n_free, -1), 0.0
    step[used] = found.x[:-1]
    return step.reshape(region.n_free, -1), float(found.x[-1] - low.min())


def _linearised(local: Floats, quality: Floats, region: FreeRegion) -> tuple[csr_array, Floats]:
    """−∇ log q of the cells near the worst, one row for each cell, and their log q."""
    shares = cell_gradient(local, region.groups, np.ones(len(quality)), _METRIC)
    rows, columns = list[Integers](), list[Integers]()
    values, low = list[Floats](), list[Floats]()
    first, d = 0, local.shape[1]
    for group, share in zip(region.groups, shares, strict=True):
        own = quality[first : first + len(group)]
        near = np.flatnonzero(own < _WINDOW * quality.min())
        column = group.nodes[near][:, :, None] * d + np.arange(d)
        row = np.broadcast_to(len(np.concatenate([*low, []])) + np.arange(len(near))[:, None, None], column.shape)
        free = column < region.n_free * d
        rows, columns, values = [*rows, row[free]], [*columns, column[free]], [*values, share[near][free]]
        low.append(np.log(own[near]))
        first += len(group)
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    count = sum(map(len, low))
    return csr_array(entries, shape=(count, region.n_free * d)), np.concatenate(low)


def shortest(sizes: Floats, d: int) -> float:
    """Approximate shortest edge of cells with these sizes (m,)."""
    return float(np.abs(sizes).min() ** (1 / d))
