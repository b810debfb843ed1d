"""The worst cells of a mesh, exactly, without the distributions: what accepting or refusing a motion needs.

Each part of the cells keeps its worst ones so far. A chunk of tetrahedra that are all certainly better than those (a
comparison of sixth powers, :func:`~mesh_motion_server.numerics.simplex_kernels.tetra_all_above`) is passed over, every
other chunk is evaluated as for the full summary; so minimum, inverted cells and worst cells are bitwise those of
:func:`~mesh_motion_server.numerics.mesh_summary.mesh_summary`, for about half of its time.

Bounds on how much a cell can have changed since another motion were measured and are not used: a bound per chunk of 128
cells from the range of its nodes' displacements is 45 times the true distortion, and with the chunk's affine part taken
out it costs half of what evaluating all cells does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.corner_kernels import (
    CHUNK,
    MEAN_RATIO,
    METRIC_CODES,
    RELATIVE,
    evaluate,
    gather,
    metric_value,
    relative_skew,
)
from mesh_motion_server.numerics.metrics import (
    AtRest,
    as_positions,
    judged_blocks,
    metric_code,
    rest_for,
    subset_quality,
)
from mesh_motion_server.numerics.quality_summary import LowestQuality, Minimum, worst_cells
from mesh_motion_server.numerics.quality_tally import PARTS
from mesh_motion_server.numerics.simplex_kernels import tetra_all_above

__all__ = ["LowestJudge", "lowest_quality"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_SIZE_SKEW = METRIC_CODES["size-skew"]
# cells that are looked at first
_SAMPLE = 4096


@njit(cache=True, error_model="numpy")
def _keep(value, cell, values, cells):  # type: ignore[no-untyped-def]
    """Put a value into the ascending values (k,), behind its equals, and its cell beside it; the last ones fall out."""
    place = values.size
    while place > 0 and value < values[place - 1]:
        place -= 1
        if place + 1 < values.size:
            values[place + 1], cells[place + 1] = values[place], cells[place]
    if place < values.size:
        values[place], cells[place] = value, cell


@njit(cache=True, error_model="numpy", parallel=True)
def _lowest(  # type: ignore[no-untyped-def]
    points, nodes, corners, shape, ideal, reference, rest, rows, metric, values, numbers, inversions
):
    """Sort the cells of one block, numbers ``rows[0]`` … of ``rows[1]`` in all, into each part's lowest (PARTS, k)."""
    m, d = nodes.shape[0], points.shape[1]
    start, total = rows
    low = start * PARTS // total
    by_powers = shape == MEAN_RATIO and corners.shape[0] == 1 and d == 3 and metric in (_SIZE_SKEW, RELATIVE)
    for i in prange(min(PARTS, (start + m) * PARTS // total + 1) - low):
        part = low + i
        begin, end = max(part * total // PARTS - start, 0), min((part + 1) * total // PARTS - start, m)
        jacobians = np.empty((corners.shape[0], d, d, CHUNK))
        work, size, skew, inverted = np.empty((5, CHUNK)), np.empty(CHUNK), np.empty(CHUNK), np.empty(CHUNK, np.bool_)
        kept, places, found = values[part], numbers[part], 0
        for first in range(begin, end, CHUNK):
            count = min(CHUNK, end - first)
            gather(points, nodes, corners, first, count, jacobians)
            if by_powers and tetra_all_above(jacobians, first, count, ideal, reference, rest, kept[-1]):
                continue
            evaluate(jacobians, first, count, shape, ideal, reference, work, size, skew, inverted)
            for s in range(count):
                found += inverted[s]
                if metric == RELATIVE:
                    skew[s] = relative_skew(skew[s], rest[first + s])
                value = metric_value(size[s], skew[s], metric)
                if value < kept[-1]:
                    _keep(value, start + first + s, kept, places)
        inversions[part] += found


def lowest_quality(
    points: NDArray[np.floating],
    cells: CellTable,
    reference_sizes: AtRest,
    *,
    metric: str = "size-skew",
    worst: int = 10,
) -> LowestQuality:
    """The minimum of a metric, the number of inverted cells and the ``worst`` ≥ 1 worst cells; all exact.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    cells : CellTable
    reference_sizes : (m,) array or CellsAtRest
        From :func:`~mesh_motion_server.numerics.metrics.reference_sizes` or :func:`.cells_at_rest`.
    metric : str
        One of :data:`~mesh_motion_server.numerics.metrics.QUALITY_METRICS`.
    worst : int

    Raises
    ------
    InvalidInput
        On an unknown metric.
    """
    positions = as_positions(points, cells.dimension)
    numbers, inverted = _lowest_numbers(positions, cells, reference_sizes, metric, worst)
    quality = subset_quality(positions, cells, reference_sizes, numbers)
    return LowestQuality(
        metric_name=metric,
        metric=Minimum(float(quality.metric(metric)[0])),
        inverted=inverted,
        cells=len(cells),
        worst=worst_cells(numbers, quality, cells.centres(points, numbers), metric),
    )


@dataclass(frozen=True, eq=False)
class LowestJudge:
    """A :class:`~mesh_motion_server.numerics.evaluation.Judge` that leaves the distributions out.

    Attributes
    ----------
    cells : CellTable
    reference_sizes : (m,) array or CellsAtRest
    """

    cells: CellTable
    reference_sizes: AtRest

    def summary(self, points: Floats, metric: str) -> LowestQuality:
        """What decides about the mesh with its nodes at ``points`` (n, d)."""
        return lowest_quality(points, self.cells, self.reference_sizes, metric=metric)


def _lowest_numbers(
    positions: Floats, cells: CellTable, reference_sizes: AtRest, metric: str, count: int
) -> tuple[Ints, int]:
    """Numbers of the ``count`` worst cells, worst first and of equal ones the lower, and how many are inverted."""
    values, numbers = np.empty((PARTS, count)), np.full((PARTS, count), len(cells))
    values[:] = _first_limit(positions, cells, reference_sizes, metric, count)
    inversions = np.zeros(PARTS, dtype=np.int64)
    code = metric_code(metric)
    for rows, sort in judged_blocks(_lowest, positions, cells, rest_for(metric, reference_sizes)):
        sort((rows.start, len(cells)), code, values, numbers, inversions)
    order = np.lexsort((numbers.ravel(), values.ravel()))[: min(count, len(cells))]
    return numbers.ravel()[order], int(inversions.sum())


def _first_limit(positions: Floats, cells: CellTable, reference_sizes: AtRest, metric: str, count: int) -> float:
    """A number above the ``count`` lowest values: most chunks can be passed over from the beginning."""
    sample = np.arange(0, len(cells), max(1, len(cells) // _SAMPLE))
    if len(sample) < count:
        return np.inf
    quality = subset_quality(positions, cells, reference_sizes, sample)
    values = quality.metric(metric)
    return float(np.nextafter(np.partition(values, count - 1)[count - 1], np.inf))
