"""The worst cells of a mesh, exactly, without the distributions: what accepting or refusing a motion needs.

Most tetrahedra are told to be better than those by a comparison of sixth powers (``kernels/src/quality/summaries.h``),
all others are judged as for the full summary; so minimum, inverted cells and worst cells are bitwise those of
:func:`~mesh_motion_server.numerics.quality.mesh_summary.mesh_summary`.

Bounds on how much a cell can have changed since another motion were measured and are not used: a bound per chunk of 128
cells from the range of its nodes' displacements is 45 times the true distortion, and with the chunk's affine part taken
out it costs half of what evaluating all cells does.
"""

from __future__ import annotations

from dataclasses import dataclass

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
from mesh_motion_server.numerics.quality.quality_summary import LowestQuality, Minimum, worst_cells

__all__ = ["LowestJudge", "lowest_quality"]

Floats = NDArray[np.float64]


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
        From :func:`~mesh_motion_server.numerics.quality.metrics.reference_sizes` or :func:`.cells_at_rest`.
    metric : str
        One of :data:`~mesh_motion_server.numerics.quality.metrics.QUALITY_METRICS`.
    worst : int

    Raises
    ------
    InvalidInput
        On an unknown metric.
    """
    positions, arrays = as_positions(points, cells.dimension), judged(cells, rest_for(metric, reference_sizes))
    values, numbers, inverted = kernels.lowest_cells(positions, *arrays, metric_code(metric), worst)
    quality = subset_quality(positions, cells, reference_sizes, numbers)
    return LowestQuality(
        metric_name=metric,
        metric=Minimum(float(values[0])),
        inverted=inverted,
        cells=len(cells),
        worst=worst_cells(numbers, quality, cells.centres(points, numbers), metric),
    )


@dataclass(frozen=True, eq=False)
class LowestJudge:
    """A :class:`~mesh_motion_server.numerics.quality.quality_summary.Judge` that leaves the distributions out.

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
