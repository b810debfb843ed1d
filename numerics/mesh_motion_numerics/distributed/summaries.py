"""Joins the quality of a mesh from its partitions: each partition sends its part in some kilobytes.

Minimum, percentiles, worst cells and the number of inverted cells are exact to the last bit; the sum of a mean has
another order.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mesh_motion_numerics.distributed.order_statistics import WHOLE, BinContent, Way, narrowed
from mesh_motion_numerics.quality.quality_summary import (
    Distribution,
    QualitySummary,
    WorstCell,
    percentile_ranks,
    reported_metrics,
)

Questions = tuple[tuple[str, Way], ...]
"""Metrics, each with a bin to report."""

#: Number of worst cells that a partition reports.
WORST = 10


@dataclass(frozen=True, eq=False)
class PartialSummary:
    """The quality of one partition's cells."""

    cells: int
    inverted: int
    #: sums, minima: sum and minimum of each metric
    sums: dict[str, float]
    minima: dict[str, float]
    worst: tuple[WorstCell, ...]  # the worst cells of the partition


def joined(
    parts: Sequence[PartialSummary], metric: str, ask: Callable[[Questions], Sequence[Sequence[BinContent]]]
) -> QualitySummary:
    """Return the summary of the whole mesh.

    Parameters
    ----------
    metric : str
        The metric of the parts.
    ask : callable
        Asks all partitions for bins; returns the contents of each question, partition by partition.
    """
    cells = sum(part.cells for part in parts)
    percentiles = _percentiles(metric, cells, ask)
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
        found, metric, inverted=sum(part.inverted for part in parts), cells=cells, worst=tuple(worst[:WORST])
    )


def first_questions(metric: str) -> Questions:
    """Questions about all values of each metric of a report."""
    return tuple((name, WHOLE) for name in reported_metrics(metric))


def _percentiles(
    metric: str, cells: int, ask: Callable[[Questions], Sequence[Sequence[BinContent]]]
) -> dict[tuple[str, int], float]:
    """The values of the percentiles, by metric and rank in ascending order."""
    found: dict[tuple[str, int], float] = {}
    questions = first_questions(metric)
    open_ways = {(name, rank): (way, rank) for name, way in questions for rank in percentile_ranks(cells)}
    while open_ways:
        known = dict(zip(questions, ask(questions), strict=True))
        steps = {key: narrowed(way, rank, known[key[0], way]) for key, (way, rank) in open_ways.items()}
        found |= {key: step for key, step in steps.items() if isinstance(step, float)}
        open_ways = {key: step for key, step in steps.items() if not isinstance(step, float)}
        questions = tuple(dict.fromkeys((name, way) for (name, _), (way, _) in open_ways.items()))
    return found
