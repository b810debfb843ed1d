"""The values of a quality report: extremes, mean, percentiles and the worst cells."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mesh_motion_kernels as kernels
import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers

__all__ = [
    "Distribution",
    "Judgement",
    "LowestQuality",
    "Minimum",
    "QualitySummary",
    "WorstCell",
    "distribution",
    "percentile_ranks",
    "reported_metrics",
    "smallest",
    "worst_cells",
]


_PERCENTILES = (1, 5, 50)


@dataclass(frozen=True)
class Distribution:
    """A quality metric over a mesh.

    Attributes
    ----------
    min, mean : float
        -inf if a cell's position is not finite.
    p1, p5, p50 : float
        Percentiles: the values of the cells with rank ⌊p (m - 1) / 100⌋ in ascending order.
    """

    min: float
    mean: float
    p1: float
    p5: float
    p50: float


@dataclass(frozen=True)
class WorstCell:
    """One of the worst cells of a mesh.

    Attributes
    ----------
    number : int
        Cell number, through the blocks of the cell table.
    centre : tuple of d floats
        Mean of the cell's nodes, mesh length unit.
    value : float
        Value of the metric that ranks the cells.
    """

    number: int
    centre: tuple[float, ...]
    value: float
    size: float
    skew: float
    size_skew: float


@dataclass(frozen=True)
class Minimum:
    """The smallest value of a quality metric over a mesh."""

    min: float


@dataclass(frozen=True)
class LowestQuality:
    """The worst cells of a mesh, which decide about a motion, without the distributions; all exact.

    Attributes
    ----------
    metric_name : str
        The metric of ``metric`` and ``worst``.
    inverted, cells, worst
        As in :class:`QualitySummary`.
    """

    metric_name: str
    metric: Minimum
    inverted: int
    cells: int
    worst: tuple[WorstCell, ...]

    @property
    def reported(self) -> dict[str, Minimum]:
        """The metrics of a report, by name."""
        return {"metric": self.metric}


@dataclass(frozen=True)
class QualitySummary:
    """Quality of a mesh in a few numbers.

    Attributes
    ----------
    metric_name : str
        The metric of ``metric`` and ``worst``.
    inverted : int
        Number of cells with a corner determinant ≤ 0.
    cells : int
        Number of cells.
    worst : tuple of WorstCell
        Worst first; of equal cells the lower number first.
    """

    metric_name: str
    metric: Distribution
    size: Distribution
    skew: Distribution
    size_skew: Distribution
    inverted: int
    cells: int
    worst: tuple[WorstCell, ...]

    @classmethod
    def of(
        cls, found: Mapping[str, Distribution], metric: str, *, inverted: int, cells: int, worst: tuple[WorstCell, ...]
    ) -> QualitySummary:
        """Build it from the distributions of :func:`reported_metrics`, by name."""
        reported = found[metric], found["size"], found["skew"], found["size-skew"]
        return cls(metric, *reported, inverted, cells, worst)

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
    rows = zip(numbers.tolist(), centres.tolist(), values.tolist(), strict=True)
    return tuple(WorstCell(number, tuple(centre), *row) for number, centre, row in rows)
