"""What a report says about the quality of a mesh: extremes, mean, percentiles and the worst cells.

All values lie in [-1, 1] (or are -inf), so a histogram finds the bin of each percentile in one threaded pass, and only
the values in that bin are sorted: exact percentiles of millions of cells for the price of reading them twice.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.read_only import read_only
from mesh_motion_server.numerics.thread_share import threads_for

if TYPE_CHECKING:
    from mesh_motion_server.numerics.metrics import CellQuality

__all__ = ["Distribution", "QualitySummary", "WorstCell", "distribution", "smallest", "summarize"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_BINS = 2048
# work items of the parallel pass: fixed, so that the mean does not depend on the number of threads
_PARTS = 64
_PERCENTILES = (1, 5, 50)
# fewer are done before a thread is awake
_VALUES_PER_THREAD = 50_000


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
        Of the metric the summary ranks by.
    size, skew, size_skew : float
    """

    number: int
    centre: tuple[float, ...]
    value: float
    size: float
    skew: float
    size_skew: float


@dataclass(frozen=True)
class QualitySummary:
    """Quality of a mesh in a few numbers.

    Attributes
    ----------
    metric_name : str
        The metric that ``metric`` and ``worst`` are about.
    metric, size, skew, size_skew : Distribution
    inverted : int
        Number of cells with a corner determinant ≤ 0.
    cells : int
        Number of cells.
    worst : tuple of WorstCell
        Worst first; of equal ones the lower cell number.
    """

    metric_name: str
    metric: Distribution
    size: Distribution
    skew: Distribution
    size_skew: Distribution
    inverted: int
    cells: int
    worst: tuple[WorstCell, ...]


@njit(cache=True)
def _bin(value: float) -> int:
    """Histogram bin of a value in [-1, 1]; -inf goes to the first."""
    return 0 if not value > -1.0 else min(_BINS - 1, int((value + 1.0) * (0.5 * _BINS)))


@njit(cache=True, parallel=True)
def _fill_histogram(values, counts, sums, minima, maxima):  # type: ignore[no-untyped-def]
    """Counts (PARTS, BINS) from zero, and sum, minimum and maximum of each part."""
    m = values.size
    for part in prange(_PARTS):
        total, least, most = 0.0, np.inf, -np.inf
        for e in range(part * m // _PARTS, (part + 1) * m // _PARTS):
            counts[part, _bin(values[e])] += 1
            total += values[e]
            least, most = min(least, values[e]), max(most, values[e])
        sums[part], minima[part], maxima[part] = total, least, most


@njit(cache=True, parallel=True)
def _gather_bins(values, wanted, starts, out):  # type: ignore[no-untyped-def]
    """Numbers of the values in the wanted bins; those of a part go to out from its start on."""
    m = values.size
    for part in prange(_PARTS):
        place = starts[part]
        for e in range(part * m // _PARTS, (part + 1) * m // _PARTS):
            if wanted[_bin(values[e])]:
                out[place] = e
                place += 1


class _Histogram(NamedTuple):
    """(PARTS, BINS) counts, and sum, minimum and maximum of each part."""

    counts: Ints
    sums: Floats
    minima: Floats
    maxima: Floats


def _histogram(values: Floats) -> _Histogram:
    counts = np.zeros((_PARTS, _BINS), dtype=np.int64)
    sums, minima, maxima = np.empty(_PARTS), np.empty(_PARTS), np.empty(_PARTS)
    with threads_for(len(values) // _VALUES_PER_THREAD):
        _fill_histogram(values, counts, sums, minima, maxima)
    return _Histogram(counts, sums, minima, maxima)


def _in_bins(values: Floats, wanted: NDArray[np.bool_], counts: Ints) -> Ints:
    """Numbers, ascending, of the values in the wanted bins; counts as from _histogram."""
    starts = np.concatenate([[0], np.cumsum(counts[:, wanted].sum(axis=1))])
    out = np.empty(starts[-1], dtype=np.int64)
    with threads_for(len(values) // _VALUES_PER_THREAD):
        _gather_bins(values, wanted, starts, out)
    return out


def distribution(values: Floats) -> Distribution:
    """Minimum, mean and percentiles of the values (m,), m ≥ 1, of a quality metric."""
    values = read_only(values)
    return _distribution(values, _histogram(values))


def _distribution(values: Floats, histogram: _Histogram) -> Distribution:
    least, mean = float(histogram.minima.min()), float(histogram.sums.sum() / len(values))
    if least == histogram.maxima.max():  # a mesh at rest: every size is 1
        return Distribution(least, mean, least, least, least)
    return Distribution(least, mean, *_order_statistics(values, histogram.counts, _PERCENTILES))


def smallest(values: Floats, count: int) -> Ints:
    """Numbers of the smallest values, smallest first; of equal values the lower number first."""
    values = read_only(values)
    return _smallest(values, count, _histogram(values).counts)


def _smallest(values: Floats, count: int, counts: Ints) -> Ints:
    count = min(count, len(values))
    wanted = np.arange(_BINS) <= np.searchsorted(np.cumsum(counts.sum(axis=0)), count)
    candidates = _in_bins(values, wanted, counts)
    if len(candidates) > count > 0:
        found = values[candidates]
        limit = np.partition(found, count - 1)[count - 1]
        less, equal = candidates[found < limit], candidates[found == limit]
        candidates = np.sort(np.concatenate([less, equal[: count - len(less)]]))
    order: Ints = candidates[np.argsort(values[candidates], kind="stable")]
    return order[:count]


def summarize(
    quality: CellQuality,
    points: NDArray[np.floating],
    cells: CellTable,
    *,
    metric: str = "size-skew",
    worst: int = 10,
) -> QualitySummary:
    """Reduce the quality of all cells to what a report says.

    Parameters
    ----------
    quality : CellQuality
        Of all m cells.
    points : (n, d) array, mesh length unit
        For the centres of the worst cells.
    cells : CellTable
    metric : str
        One of :data:`~mesh_motion_server.numerics.metrics.QUALITY_METRICS`; ranks the worst cells.
    worst : int
        How many of the worst cells to name.

    Raises
    ------
    InvalidInput
        On an unknown metric.
    """
    names = dict.fromkeys(("size", "skew", "size-skew", metric))
    values = {name: read_only(quality.metric(name)) for name in names}
    histograms = {name: _histogram(of) for name, of in values.items()}
    found = {name: _distribution(values[name], histograms[name]) for name in names}
    numbers = _smallest(values[metric], worst, histograms[metric].counts)
    centres = cells.centres(points, numbers)
    return QualitySummary(
        metric_name=metric,
        metric=found[metric],
        size=found["size"],
        skew=found["skew"],
        size_skew=found["size-skew"],
        inverted=int(np.count_nonzero(quality.inverted)),
        cells=len(quality),
        worst=tuple(
            WorstCell(
                number=int(cell),
                centre=tuple(float(x) for x in centre),
                value=float(values[metric][cell]),
                size=float(values["size"][cell]),
                skew=float(values["skew"][cell]),
                size_skew=float(values["size-skew"][cell]),
            )
            for cell, centre in zip(numbers, centres, strict=True)
        ),
    )


def _order_statistics(values: Floats, counts: Ints, percentiles: tuple[int, ...]) -> list[float]:
    """The values with rank ⌊p (m - 1) / 100⌋ in ascending order, from one pass over those in their bins."""
    total = counts.sum(axis=0)
    below = np.cumsum(total)
    ranks = [p * (len(values) - 1) // 100 for p in percentiles]
    places = np.searchsorted(below, ranks, side="right")
    kept = np.unique(places)
    before = dict(zip(kept.tolist(), (np.cumsum(total[kept]) - total[kept]).tolist(), strict=True))
    inside = [
        before[int(place)] + rank - int(below[place] - total[place]) for rank, place in zip(ranks, places, strict=True)
    ]
    candidates = values[_in_bins(values, np.isin(np.arange(_BINS), places), counts)]
    return [float(value) for value in np.partition(candidates, inside)[inside]]
