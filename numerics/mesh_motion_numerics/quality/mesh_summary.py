"""The quality of a mesh in a few numbers: its distributions, or only its worst cells, which decide about a motion.

:func:`mesh_summary` and :func:`lowest_quality` go through the cells once and store no array as large as the mesh;
:func:`summarize` and :func:`lowest_of` take the known quality of every cell. All give bitwise equal results.

To find only the worst cells, a comparison of sixth powers excludes most tetrahedra
(``kernels/src/quality/summaries.h``).
Bounds on the change of a cell since another motion were tried and are not used: a bound per chunk of 128 cells from
the range of its nodes' displacements is 45 times the true distortion; without the chunk's affine part, it costs half as
much as evaluating all cells.
"""

from itertools import starmap

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import (
    AtRest,
    CellQuality,
    as_positions,
    judged,
)
from mesh_motion_numerics.quality.quality_summary import (
    Distribution,
    LowestQuality,
    Minimum,
    QualitySummary,
    distribution,
    reported_metrics,
    smallest,
    worst_cells,
)

__all__ = ["lowest_of", "lowest_quality", "mesh_summary", "summarize"]


def mesh_summary(
    points: NDArray[np.floating],
    cells: CellTable,
    reference_sizes: AtRest,
    *,
    metric: str = "size-skew",
    worst: int = 10,
) -> QualitySummary:
    """Quality of all cells in the form of a report.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    reference_sizes : (m,) array or CellsAtRest
        From :func:`~mesh_motion_numerics.quality.metrics.reference_sizes` or :func:`.cells_at_rest`.
    metric : str
        One of :data:`~mesh_motion_numerics.quality.metrics.QUALITY_METRICS`; ranks the worst cells.
    worst : int
        Number of worst cells to name.

    Raises
    ------
    InvalidInput
        On an unknown metric.
    """
    positions, arrays = as_positions(points, cells.dimension), judged(cells, reference_sizes, metric)
    rows, numbers, inverted = kernels.judged_cells(positions, *arrays, worst)
    found = dict(zip(reported_metrics(metric), starmap(Distribution, rows.tolist()), strict=True))
    values = kernels.values_of_cells(positions, *arrays, numbers)
    named = worst_cells(numbers, cells.centres(positions, numbers), values)
    return QualitySummary.of(found, metric, inverted=inverted, cells=len(cells), worst=named)


def lowest_quality(
    points: NDArray[np.floating],
    cells: CellTable,
    reference_sizes: AtRest,
    *,
    metric: str = "size-skew",
    worst: int = 10,
) -> LowestQuality:
    """The minimum of a metric, the number of inverted cells and the ``worst`` ≥ 1 worst cells; all exact.

    Parameters and errors as those of :func:`mesh_summary`, which takes 2.5 times as long.
    """
    positions, arrays = as_positions(points, cells.dimension), judged(cells, reference_sizes, metric)
    lowest, numbers, inverted = kernels.lowest_cells(positions, *arrays, worst)
    values = kernels.values_of_cells(positions, *arrays, numbers)
    named = worst_cells(numbers, cells.centres(positions, numbers), values)
    return LowestQuality(metric, Minimum(float(lowest[0])), inverted, len(cells), named)


def summarize(
    quality: CellQuality, points: NDArray[np.floating], cells: CellTable, *, metric: str = "size-skew", worst: int = 10
) -> QualitySummary:
    """As :func:`mesh_summary`, from the ``quality`` of all m cells; ``points`` (n, d) give the worst cells' centres."""
    values = {name: quality.metric(name) for name in reported_metrics(metric)}
    numbers = smallest(values[metric], worst)
    return QualitySummary.of(
        {name: distribution(own) for name, own in values.items()},
        metric,
        inverted=int(np.count_nonzero(quality.inverted)),
        cells=len(quality),
        worst=worst_cells(numbers, cells.centres(points, numbers), quality.worst(numbers, metric)),
    )


def lowest_of(
    quality: CellQuality, points: NDArray[np.floating], cells: CellTable, *, metric: str = "size-skew", worst: int = 10
) -> LowestQuality:
    """As :func:`lowest_quality`, from the ``quality`` of all m cells; ``points`` (n, d) as for :func:`summarize`."""
    values = quality.metric(metric)
    numbers = smallest(values, worst)
    return LowestQuality(
        metric,
        Minimum(float(values[numbers[0]])),
        int(np.count_nonzero(quality.inverted)),
        len(quality),
        worst_cells(numbers, cells.centres(points, numbers), quality.worst(numbers, metric)),
    )
