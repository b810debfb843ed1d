"""The quality of cells on the ranks of a client, as plain values and arrays: the content of JUDGE.

A rank reports the quality of its cells, and the contents of the requested bins. Each report has everything again, so
that the session stores nothing between two messages: either the quality is complete, or the session requests more bins.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.distributed.order_statistics import BINS, WHOLE, BinContent, Way
from mesh_motion_numerics.distributed.summaries import PartialSummary, Questions, joined
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_numerics.quality.quality_summary import QualitySummary, WorstCell, reported_metrics

#: Columns of a worst cell before its centre: type, local number, value, size, skew, size-skew.
_WORST_COLUMNS = 6
_TYPES = tuple(CELL_TYPES)


class Unanswered(Exception):
    """The report of some bins is still missing."""

    def __init__(self, questions: Questions) -> None:
        super().__init__("bins are not known yet")
        self.questions = questions


@dataclass(frozen=True, eq=False)
class RankReport:
    """The report of one rank: its part of the summary, and the contents of each requested bin."""

    part: PartialSummary
    answers: Mapping[tuple[str, Way], BinContent]


def as_plain(questions: Questions) -> list[dict[str, Any]]:
    """Questions as maps and lists."""
    return [{"metric": name, "way": [list(division) for division in way]} for name, way in questions]


def read_questions(plain: Sequence[Mapping[str, Any]]) -> Questions:
    """The inverse of :func:`as_plain`."""
    return tuple(
        (str(one["metric"]), tuple((float(low), float(scale), int(wanted)) for low, scale, wanted in one["way"]))
        for one in plain
    )


def report_fields(
    part: PartialSummary, place: Callable[[int], tuple[str, int]], questions: Questions, answers: Sequence[BinContent]
) -> dict[str, Any]:
    """The fields of a JUDGE.

    Parameters
    ----------
    place : callable
        Number of a worst cell → its type, and its number among those of its type.
    questions, answers
        The requested bins, and their contents.
    """
    worst = [
        (_TYPES.index(kind), local, cell.value, cell.size, cell.skew, cell.size_skew, *cell.centre)
        for cell in part.worst
        for kind, local in (place(cell.number),)
    ]
    bins = [
        np.column_stack([np.full(len(one.bins), row), one.bins, one.counts]).astype(np.int32)
        for row, one in enumerate(answers)
    ]
    values = [
        np.column_stack([np.full(len(one.values), row), one.values, one.repeated])
        for row, one in enumerate(answers)
        if one.values is not None and one.repeated is not None
    ]
    return {
        "part": {"cells": part.cells, "inverted": part.inverted, "sums": part.sums, "minima": part.minima},
        "questions": as_plain(questions),
        "bins": np.concatenate([np.empty((0, 3), dtype=np.int32), *bins]),
        "values": np.concatenate([np.empty((0, 3)), *values]),
        "worst": np.array(worst, dtype=np.float64),
    }


def read_report(fields: Mapping[str, Any], number: Callable[[str, int], int], *, partition: int) -> RankReport:
    """Read the fields of a JUDGE; ``number`` gives a cell's number from its type and its number within the type.

    Raises InvalidInput if the fields do not fit together.
    """
    with reading("JUDGE", partition):
        return _read_report(fields, number)


@contextmanager
def reading(kind: str, partition: int) -> Iterator[None]:
    """Raise InvalidInput if the fields of a request do not fit together."""
    try:
        yield
    except (IndexError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise InvalidInput(
            f"{kind} of partition {partition}: {error}",
            hint=f"section 23 of the protocol says what the fields of {kind} contain",
            details={"partition": partition},
        ) from error


def _read_report(fields: Mapping[str, Any], number: Callable[[str, int], int]) -> RankReport:
    part, bins, values, worst = (fields[name] for name in ("part", "bins", "values", "worst"))
    require(bins.ndim == 2 and bins.shape[1] == 3, "bins: expected three columns")
    require(values.ndim == 2 and values.shape[1] == 3, "values: expected three columns")
    require(worst.ndim == 2 and worst.shape[1] > _WORST_COLUMNS, "worst: expected more than six columns")
    require(not len(bins) or (bins[:, 1].min() >= 0 and bins[:, 1].max() < BINS), f"bins: expected 0 to {BINS - 1}")
    require(not len(bins) or bins[:, 2].min() > 0, "bins: expected positive counts")
    answers = {
        question: _content(bins[bins[:, 0] == row], values[values[:, 0] == row])
        for row, question in enumerate(read_questions(fields["questions"]))
    }
    cells = int(part["cells"])
    for (name, way), one in answers.items():
        require(way != WHOLE or int(one.counts.sum()) == cells, f"bins: expected {cells} values of {name}")
    cells_worst = tuple(
        WorstCell(number(_TYPES[int(kind)], int(local)), tuple(centre), *of_cell)
        for kind, local, *of_cell, centre in ((*row[:_WORST_COLUMNS], row[_WORST_COLUMNS:]) for row in worst.tolist())
    )
    sums, minima = ({str(name): float(value) for name, value in part[key].items()} for key in ("sums", "minima"))
    return RankReport(PartialSummary(cells, int(part["inverted"]), sums, minima, cells_worst), answers)


def require(good: bool, expected: str) -> None:
    """Raise ValueError that names the ``expected`` condition, unless it is met."""
    if not good:
        raise ValueError(expected)


def _content(bins: Integers, values: Floats) -> BinContent:
    """Read one bin: its parts with their counts, and its values if all of them were sent."""
    repeated = values[:, 2].astype(np.int64)
    whole = int(repeated.sum()) == int(bins[:, 2].sum())
    return BinContent(
        bins[:, 1].astype(np.uint16),
        bins[:, 2].astype(np.uint32),
        values[:, 1] if whole else None,
        repeated if whole else None,
    )


def summary_of(ranks: Sequence[RankReport], metric: str) -> QualitySummary:
    """Return the quality of all cells.

    Raises Unanswered if more bins are needed. Raises InvalidInput if a rank reports other metrics, or the reports of
    the ranks do not fit together.
    """

    def ask(questions: Questions) -> list[list[BinContent]]:
        missing = tuple(one for one in questions if any(one not in rank.answers for rank in ranks))
        if missing:
            raise Unanswered(missing)
        return [[rank.answers[one] for rank in ranks] for one in questions]

    names = set(reported_metrics(metric))
    for place, rank in enumerate(ranks):
        if set(rank.part.sums) != names or set(rank.part.minima) != names or not rank.part.cells:
            raise InvalidInput(
                f"JUDGE of partition {place}: expected at least one cell, and sums and minima of {sorted(names)}",
                details={"partition": place},
            )
    try:
        return joined([rank.part for rank in ranks], metric, ask)
    except IndexError as error:
        raise InvalidInput(
            "JUDGE: the bins that the partitions report do not add up",
            hint="each partition reports all values of each question, and all partitions the same trial",
        ) from error
