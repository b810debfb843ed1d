"""Reports of ranks about their cells are added exactly; inconsistent reports are refused."""

from dataclasses import asdict
from typing import Any

import numpy as np
import pytest
from mesh_motion_numerics.distributed.judging import Unanswered, as_plain, read_report, report_fields, summary_of
from mesh_motion_numerics.distributed.order_statistics import content
from mesh_motion_numerics.distributed.summaries import PartialSummary, Questions, first_questions
from mesh_motion_numerics.quality.metrics import CellQuality
from mesh_motion_numerics.quality.quality_summary import distribution, smallest, worst_cells
from mesh_motion_protocol.errors import InvalidInput

METRIC = "size-skew"
RANKS = (4000, 1, 700)


def quality(count: int, seed: int) -> CellQuality:
    """Values of some cells; many of them are equal, as at rest."""
    random = np.random.default_rng(seed)
    size, skew = np.minimum(random.uniform(0.2, 1.3, count), 1.0), random.uniform(0.4, 1.0, count)
    return CellQuality(size, skew, size < 0.21)


def fields(number: int, further: Questions = ()) -> dict[str, Any]:
    own = quality(RANKS[number], number)
    values = {name: own.metric(name) for name in ("size", "skew", METRIC)}
    worst = smallest(values[METRIC], 10)
    part = PartialSummary(
        cells=len(own),
        inverted=int(own.inverted.sum()),
        sums={name: float(one.sum()) for name, one in values.items()},
        minima={name: float(one.min()) for name, one in values.items()},
        worst=worst_cells(worst, np.zeros((len(worst), 3)), own.worst(worst, METRIC)),
    )
    questions = (*first_questions(METRIC), *further)
    answers = [content(own.metric(name), way) for name, way in questions]
    return report_fields(part, lambda cell: ("tetra", cell), questions, answers)


def number_of(rank: int) -> Any:
    def number(kind: str, local: int) -> int:
        if kind != "tetra" or not 0 <= local < RANKS[rank]:
            raise IndexError(f"no cell {local} of type {kind}")
        return sum(RANKS[:rank]) + local

    return number


def listened(further: Questions = ()) -> list[Any]:
    return [read_report(fields(rank, further), number_of(rank), partition=rank) for rank in range(len(RANKS))]


def test_the_quality_is_that_of_all_cells() -> None:
    further: Questions = ()
    found = None
    while found is None:
        try:
            found = summary_of(listened(further), METRIC)
        except Unanswered as unknown:
            further += unknown.questions
    assert 3 <= len(further) <= 36
    each = [quality(count, seed) for seed, count in enumerate(RANKS)]
    for name in ("size", "skew", METRIC):
        expected = asdict(distribution(np.concatenate([own.metric(name) for own in each])))
        got = asdict(found.reported["size_skew" if name == METRIC else name])
        assert got.pop("mean") == pytest.approx(expected.pop("mean"), rel=1e-14)
        assert got == expected
    values = np.concatenate([own.metric(METRIC) for own in each])
    assert [cell.number for cell in found.worst] == np.argsort(values, kind="stable")[:10].tolist()
    assert found.inverted == sum(int(np.count_nonzero(own.inverted)) for own in each)


def test_a_question_is_read_as_it_was_asked() -> None:
    questions: Questions = (("size", ((-1.0, 1024.0, 7), (-0.9931640625, 2097152.0, 2047))),)
    assert as_plain(first_questions(METRIC))[1] == {"metric": "skew", "way": []}
    assert list(listened(questions)[0].answers) == [*first_questions(METRIC), *questions]


@pytest.mark.parametrize(
    "change",
    [
        {"part": {}},
        {"part": {"cells": 1, "inverted": 0, "sums": {}, "minima": {}}},
        {"part": {"cells": 4000, "inverted": 0, "sums": {"size": "much"}, "minima": {}}},
        {"questions": [{"metric": "size"}]},
        {"questions": [{"metric": "size", "way": [[0.0, 1.0]]}]},
        {"bins": np.zeros((2, 2), dtype=np.int64)},
        {"bins": np.array([[0, 2048, 4000]])},
        {"bins": np.array([[0, -1, 4000]])},
        {"bins": np.array([[0, 5, 4001], [0, 6, -1]])},
        {"values": np.zeros((2, 4))},
        {"worst": np.zeros((2, 6))},
        {"worst": np.array([[99.0, 0, 0, 0, 0, 0, 0]])},
        {"worst": np.array([[3.0, 4000.0, 0, 0, 0, 0, 0]])},
        {"worst": np.array([[1e300, 0, 0, 0, 0, 0, 0]])},
    ],
)
def test_a_report_with_inconsistent_fields_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(InvalidInput, match="JUDGE of partition 0"):
        read_report(fields(0) | change, number_of(0), partition=0)


def test_values_that_are_too_few_for_a_rank_are_refused() -> None:
    further: Questions = ()
    try:
        summary_of(listened(), METRIC)
    except Unanswered as unknown:
        further = unknown.questions
    reported_by = [fields(rank, further) for rank in range(len(RANKS))]
    for one in reported_by:
        last = len(one["questions"]) - 1
        one["bins"], one["values"] = (rows[rows[:, 0] != last] for rows in (one["bins"], one["values"]))
    with pytest.raises(InvalidInput, match="do not add up"):
        summary_of([read_report(one, number_of(rank), partition=rank) for rank, one in enumerate(reported_by)], METRIC)


def test_a_rank_without_cells_or_metrics_is_refused() -> None:
    one = fields(1)
    one["part"] = one["part"] | {"sums": {"size": 1.0}}
    with pytest.raises(InvalidInput, match="sums and minima of"):
        summary_of([read_report(one, number_of(1), partition=0)], METRIC)
