"""The quality of a mesh in a few numbers: extremes, mean, percentiles, and the worst cells, which decide on a motion.

:func:`judged_mesh` goes through the cells once and stores no array as large as the mesh;
:func:`summarize` takes the known quality of every cell. Both give bitwise equal results.

To find only the worst cells, a comparison of sixth powers excludes most tetrahedra
(``kernels/src/quality/summaries.h``).
Bounds on the change of a cell since another motion were tried and are not used: a bound per chunk of 128 cells from
the range of its nodes' displacements is 45 times the true distortion; without the chunk's affine part, it costs half as
much as evaluating all cells.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import starmap

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import AtRest, CellQuality, judged

_PERCENTILES = (1, 5, 50)


@dataclass(frozen=True)
class Distribution:
    """A quality metric over a mesh."""

    #: min, mean: -inf if a cell's position is not finite
    min: float
    mean: float
    #: p1, p5, p50: Percentiles: the values of the cells with rank ⌊p (m - 1) / 100⌋ in ascending order
    p1: float
    p5: float
    p50: float


@dataclass(frozen=True)
class WorstCell:
    """One of the worst cells of a mesh."""

    number: int  # cell number, through the blocks of the cell table
    centre: tuple[float, ...]  # mean of the cell's nodes, mesh length unit
    value: float  # value of the metric that ranks the cells
    size: float
    skew: float
    size_skew: float


@dataclass(frozen=True)
class Minimum:
    """The smallest value of a quality metric over a mesh."""

    min: float


@dataclass(frozen=True)
class LowestQuality:
    """The worst cells of a mesh, which decide about a motion, without the distributions; all exact."""

    metric: Minimum
    #: inverted, cells, worst: as in :class:`QualitySummary`
    inverted: int
    cells: int
    worst: tuple[WorstCell, ...]

    @property
    def reported(self) -> dict[str, Minimum]:
        """The metrics of a report, by name."""
        return {"metric": self.metric}


@dataclass(frozen=True)
class QualitySummary:
    """Quality of a mesh in a few numbers."""

    metric: Distribution
    size: Distribution
    skew: Distribution
    size_skew: Distribution
    inverted: int  # number of cells with a corner determinant ≤ 0
    cells: int  # number of cells
    worst: tuple[WorstCell, ...]  # worst first; of equal cells the lower number first

    @classmethod
    def of(
        cls, found: Mapping[str, Distribution], metric: str, *, inverted: int, cells: int, worst: tuple[WorstCell, ...]
    ) -> QualitySummary:
        """Build it from the distributions of :func:`reported_metrics`, by name."""
        reported = found[metric], found["size"], found["skew"], found["size-skew"]
        return cls(*reported, inverted, cells, worst)

    @property
    def reported(self) -> dict[str, Distribution]:
        """The metrics of a report, by name."""
        return {"size": self.size, "skew": self.skew, "size_skew": self.size_skew, "metric": self.metric}


#: The quality of a mesh: complete, or only its worst cells.
Judgement = QualitySummary | LowestQuality


def reported_metrics(metric: str) -> list[str]:
    """The metrics whose distributions a report has; the session's metric comes last if it is none of the others."""
    return list(dict.fromkeys(("size", "skew", "size-skew", metric)))


def distribution(values: Floats) -> Distribution:
    """Minimum, mean and percentiles of the values (m,), m ≥ 1, of a quality metric."""
    return Distribution(*kernels.distribution(np.ascontiguousarray(values)).tolist())


def smallest(values: Floats, count: int) -> Integers:
    """Numbers of the smallest values, smallest first; of equal values the lower number first."""
    numbers: Integers = kernels.smallest_values(np.ascontiguousarray(values), count)
    return numbers


def percentile_ranks(count: int) -> list[int]:
    """Ranks, from 0 in ascending order, of the percentiles p1, p5 and p50 of ``count`` values."""
    return [p * (count - 1) // 100 for p in _PERCENTILES]


def worst_cells(numbers: Integers, centres: Floats, values: Floats) -> tuple[WorstCell, ...]:
    """The records of cells (s,): their centres (s, d), and the values (s, 4) of the metric, size, skew, size-skew."""
    each = zip(numbers.tolist(), map(tuple, centres.tolist()), *values.T.tolist(), strict=True)
    return tuple(starmap(WorstCell, each))


def judged_mesh(
    points: NDArray[np.floating],
    cells: CellTable,
    reference_sizes: AtRest,
    *,
    metric: str = "size-skew",
    worst: int = 10,
    distributions: bool = True,
    limit: float = 0.0,
) -> tuple[Judgement, Integers]:
    """Quality of all cells in the form of a report, and the cells whose worst corner is below a limit.

    Raises InvalidInput on an unknown metric.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    reference_sizes : (m,) array or CellsAtRest
        From :func:`~mesh_motion_numerics.quality.metrics.reference_sizes` or :func:`.cells_at_rest`.
    metric : str
        One of :data:`~mesh_motion_numerics.quality.metrics.QUALITY_METRICS`; ranks the worst cells.
    worst : int
        Number of worst cells to name; at least 1 without ``distributions``.
    distributions : bool
        Without them it takes about half the time.
    limit : float
        Of :func:`~mesh_motion_numerics.quality.metrics.corner_quality`, for cells at rest; 0: no cell is returned.
        Together this takes two thirds of the time of both functions, a third for cells that are not simplices.

    Returns
    -------
    QualitySummary or LowestQuality, (k,) int64 array
        The quality, and the numbers of those cells, ascending.
    """
    arrays = judged(points, cells, reference_sizes, metric)
    judge = kernels.judged_cells if distributions else kernels.lowest_cells
    found, numbers, inverted, distorted = judge(*arrays, worst, limit)
    named = worst_cells(numbers, cells.centres(arrays[0], numbers), kernels.values_of_cells(*arrays, numbers))
    if not distributions:
        return LowestQuality(Minimum(float(found[0])), inverted, len(cells), named), distorted
    rows = dict(zip(reported_metrics(metric), starmap(Distribution, found.tolist()), strict=True))
    return QualitySummary.of(rows, metric, inverted=inverted, cells=len(cells), worst=named), distorted


def summarize(
    quality: CellQuality,
    points: NDArray[np.floating],
    cells: CellTable,
    *,
    metric: str = "size-skew",
    worst: int = 10,
    distributions: bool = True,
) -> Judgement:
    """The quality of :func:`judged_mesh` from that of all m cells; ``points`` (n, d) give the worst cells' centres."""
    names = reported_metrics(metric) if distributions else [metric]
    values = {name: quality.metric(name) for name in names}
    numbers = smallest(values[metric], worst)
    named = worst_cells(numbers, cells.centres(points, numbers), quality.worst(numbers, metric))
    inverted = int(np.count_nonzero(quality.inverted))
    if not distributions:
        return LowestQuality(Minimum(float(values[metric][numbers[0]])), inverted, len(quality), named)
    found = {name: distribution(own) for name, own in values.items()}
    return QualitySummary.of(found, metric, inverted=inverted, cells=len(quality), worst=named)
