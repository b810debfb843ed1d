"""Joins the quality of a mesh from its partitions: each sends its part in some kilobytes.

Minimum, percentiles, worst cells and the number of inverted ones are those of the whole mesh to the last bit; a mean is
a sum in another order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.distributed.order_statistics import WHOLE, BinContent, Way, content, narrowed
from mesh_motion_server.numerics.quality.metrics import CellQuality
from mesh_motion_server.numerics.quality.quality_summary import (
    Distribution,
    QualitySummary,
    WorstCell,
    percentile_ranks,
    reported_metrics,
    smallest,
    worst_cells,
)

__all__ = ["PartialSummary", "Questions", "by_question", "joined", "part_of", "values_of"]

Floats = NDArray[np.float64]

Questions = tuple[tuple[str, Way], ...]
"""Metrics, and the bin of each that is asked for."""

_WORST = 10


@dataclass(frozen=True, eq=False)
class PartialSummary:
    """The quality of one partition's cells.

    Attributes
    ----------
    cells, inverted : int
    sums, minima : dict of str to float
        By metric.
    contents : dict of str to BinContent
        All values of each metric in bins.
    worst : tuple of WorstCell
        Its worst cells, numbered as in the mesh.
    """

    cells: int
    inverted: int
    sums: dict[str, float]
    minima: dict[str, float]
    contents: dict[str, BinContent]
    worst: tuple[WorstCell, ...]


def values_of(quality: CellQuality, metric: str) -> dict[str, Floats]:
    """Return the values (m,) of each metric of a report."""
    return {name: quality.metric(name) for name in reported_metrics(metric)}


def part_of(
    quality: CellQuality,
    values: Mapping[str, Floats],
    numbers: NDArray[np.int64],
    centres: Callable[[NDArray[np.int64]], Floats],
    *,
    metric: str,
) -> PartialSummary:
    """Return the part of a partition in a summary.

    Parameters
    ----------
    quality : CellQuality
        Of its m cells.
    values : mapping of str to (m,) array
        :func:`values_of` them.
    numbers : (m,) int64 array
        Their numbers in the mesh.
    centres : callable
        Centres (s, d) of its cells (s,), mesh length unit.
    metric : str
        Ranks the worst cells.
    """
    worst = smallest(values[metric], _WORST)
    return PartialSummary(
        cells=len(quality),
        inverted=int(np.count_nonzero(quality.inverted)),
        sums={name: float(own.sum()) for name, own in values.items()},
        minima={name: float(own.min()) for name, own in values.items()},
        contents={name: content(own, WHOLE) for name, own in values.items()},
        worst=worst_cells(numbers[worst], quality.subset(worst), centres(worst), metric),
    )


def by_question(answers: Sequence[Sequence[BinContent]]) -> list[list[BinContent]]:
    """The contents of each question, partition by partition, from each partition's answers to all of them."""
    return [list(contents) for contents in zip(*answers, strict=True)]


def joined(
    parts: Sequence[PartialSummary], metric: str, ask: Callable[[Questions], Sequence[Sequence[BinContent]]]
) -> QualitySummary:
    """Return the summary of the whole mesh.

    Parameters
    ----------
    parts : sequence of PartialSummary
    metric : str
        As in the parts.
    ask : callable
        Asks all partitions for bins; returns the contents of each question, partition by partition.
    """
    cells = sum(part.cells for part in parts)
    percentiles = _percentiles(parts, metric, cells, ask)
    found = {
        name: Distribution(
            min(part.minima[name] for part in parts),
            sum(part.sums[name] for part in parts) / cells,
            *(percentiles[name, rank] for rank in percentile_ranks(cells)),
        )
        for name in reported_metrics(metric)
    }
    worst = sorted((cell for part in parts for cell in part.worst), key=lambda cell: (cell.value, cell.number))
    return QualitySummary.of(
        found,
        metric,
        inverted=sum(part.inverted for part in parts),
        cells=cells,
        worst=tuple(worst[:_WORST]),
    )


def _percentiles(
    parts: Sequence[PartialSummary],
    metric: str,
    cells: int,
    ask: Callable[[Questions], Sequence[Sequence[BinContent]]],
) -> dict[tuple[str, int], float]:
    """The values of the percentiles, by metric and rank in ascending order."""
    found: dict[tuple[str, int], float] = {}
    open_ways: dict[tuple[str, int], tuple[Way, int]] = {}
    known: dict[tuple[str, Way], Sequence[BinContent]] = {}
    for name in reported_metrics(metric):
        known[name, WHOLE] = [part.contents[name] for part in parts]
        open_ways |= {(name, rank): (WHOLE, rank) for rank in percentile_ranks(cells)}
    while open_ways:
        steps = {key: narrowed(way, rank, known[key[0], way]) for key, (way, rank) in open_ways.items()}
        found |= {key: step for key, step in steps.items() if isinstance(step, float)}
        open_ways = {key: step for key, step in steps.items() if not isinstance(step, float)}
        questions = tuple(dict.fromkeys((name, way) for (name, _), (way, _) in open_ways.items()))
        if questions:
            known = dict(zip(questions, ask(questions), strict=True))
    return found
