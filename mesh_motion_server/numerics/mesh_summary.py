"""The quality summary of a mesh in one pass over its cells, which keeps two bytes of each cell and metric.

A pass gathers a chunk of cells, computes their size, skew and metrics in cache, and adds them to the counts of every
distribution at once (:mod:`~mesh_motion_server.numerics.quality_tally`); then the few cells in the percentiles' levels,
and the worst ones, are evaluated once more. The numbers are those of
:func:`~mesh_motion_server.numerics.quality_summary.summarize`, bitwise.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.corner_kernels import (
    CHUNK,
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
from mesh_motion_server.numerics.quality_summary import QualitySummary, reported_metrics, summary_of
from mesh_motion_server.numerics.quality_tally import PARTS, Tally, empty_tallies, tally_chunk, tally_three

__all__ = ["mesh_summary"]

Floats = NDArray[np.float64]

_SIZE_SKEW = METRIC_CODES["size-skew"]


@njit(cache=True, error_model="numpy", parallel=True)
def _judge(  # type: ignore[no-untyped-def]
    points, nodes, corners, shape, ideal, reference, rest, rows, metric, levels, counts, totals, inversions
):
    """Add the cells of one block, numbers ``rows[0]`` … of ``rows[1]`` in all, to the tallies and inversions (PARTS,).

    The tallies are those of size, skew, size-skew and, where there is a fourth, ``metric``.
    """
    m, d = nodes.shape[0], points.shape[1]
    start, total = rows
    low = start * PARTS // total
    for i in prange(min(PARTS, (start + m) * PARTS // total + 1) - low):
        part = low + i
        begin, end = max(part * total // PARTS - start, 0), min((part + 1) * total // PARTS - start, m)
        jacobians = np.empty((corners.shape[0], d, d, CHUNK))
        work, values, inverted = np.empty((5, CHUNK)), np.empty((levels.shape[0], CHUNK)), np.empty(CHUNK, np.bool_)
        found = 0
        for first in range(begin, end, CHUNK):
            count = min(CHUNK, end - first)
            gather(points, nodes, corners, first, count, jacobians)
            evaluate(jacobians, first, count, shape, ideal, reference, work, values[0], values[1], inverted)
            for s in range(count):
                values[2, s] = metric_value(values[0, s], values[1, s], _SIZE_SKEW)
                found += inverted[s]
            here = levels[:, start + first : start + first + count]
            tally_three(values, count, here, counts[part], totals[part])
            if levels.shape[0] > 3:
                for s in range(count):
                    skew = values[1, s]
                    if metric == RELATIVE:
                        skew = relative_skew(skew, rest[first + s])
                    values[3, s] = metric_value(values[0, s], skew, metric)
                tally_chunk(values[3], count, here[3], counts[part, 3], totals[part, 3])
        inversions[part] += found


def mesh_summary(
    points: NDArray[np.floating],
    cells: CellTable,
    reference_sizes: AtRest,
    *,
    metric: str = "size-skew",
    worst: int = 10,
) -> QualitySummary:
    """Quality of all cells as a report says it.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    cells : CellTable
    reference_sizes : (m,) array or CellsAtRest
        From :func:`~mesh_motion_server.numerics.metrics.reference_sizes` or :func:`.cells_at_rest`.
    metric : str
        One of :data:`~mesh_motion_server.numerics.metrics.QUALITY_METRICS`; ranks the worst cells.
    worst : int
        How many of the worst cells to name.

    Raises
    ------
    InvalidInput
        On an unknown metric.
    """
    positions, code = as_positions(points, cells.dimension), metric_code(metric)
    tallies, inverted = _judged(
        positions, cells, rest_for(metric, reference_sizes), len(reported_metrics(metric)), code
    )
    return summary_of(
        dict(zip(reported_metrics(metric), tallies, strict=True)),
        inverted,
        lambda numbers: subset_quality(positions, cells, reference_sizes, numbers),
        lambda numbers: cells.centres(points, numbers),
        metric=metric,
        worst=worst,
    )


def _judged(
    positions: Floats, cells: CellTable, reference_sizes: AtRest, count: int, metric: int
) -> tuple[list[Tally], int]:
    """The first ``count`` tallies of size, skew, size-skew and the metric, and the number of inverted cells."""
    total = len(cells)
    levels, counts, totals = empty_tallies(count, total)
    inversions = np.zeros(PARTS, dtype=np.int64)
    for rows, judge in judged_blocks(_judge, positions, cells, reference_sizes):
        judge((rows.start, total), metric, levels, counts, totals, inversions)
    return [Tally(levels[k], counts[:, k], totals[:, k]) for k in range(count)], int(inversions.sum())
