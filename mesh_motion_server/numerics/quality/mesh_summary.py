"""The quality summary of a mesh in one pass over its cells that stores nothing of the size of the mesh.

The numbers are those of :func:`~mesh_motion_server.numerics.quality.quality_summary.summarize`, bitwise.
"""

from __future__ import annotations

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.numerics.quality.metrics import (
    AtRest,
    as_positions,
    judged,
    metric_code,
    rest_for,
    subset_quality,
)
from mesh_motion_server.numerics.quality.quality_summary import (
    Distribution,
    QualitySummary,
    reported_metrics,
    worst_cells,
)

__all__ = ["mesh_summary"]


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
        From :func:`~mesh_motion_server.numerics.quality.metrics.reference_sizes` or :func:`.cells_at_rest`.
    metric : str
        One of :data:`~mesh_motion_server.numerics.quality.metrics.QUALITY_METRICS`; ranks the worst cells.
    worst : int
        How many of the worst cells to name.

    Raises
    ------
    InvalidInput
        On an unknown metric.
    """
    positions, arrays = as_positions(points, cells.dimension), judged(cells, rest_for(metric, reference_sizes))
    rows, numbers, inverted = kernels.judged_cells(positions, *arrays, metric_code(metric), worst)
    found = {name: Distribution(*row.tolist()) for name, row in zip(reported_metrics(metric), rows, strict=True)}
    quality = subset_quality(positions, cells, reference_sizes, numbers)
    named = worst_cells(numbers, quality, cells.centres(points, numbers), metric)
    return QualitySummary.of(found, metric, inverted=inverted, cells=len(cells), worst=named)
