"""Percentiles of values on several machines are those of all values in one place."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_motion_numerics.distributed.order_statistics import BINS, WHOLE, Way, content, merged_counts, narrowed


def found(parts: list[np.ndarray], rank: int) -> tuple[float, int]:
    """The value of a rank, and the number of rounds for it."""
    way: Way = WHOLE
    for rounds in range(1, 20):
        step = narrowed(way, rank, [content(part, way) for part in parts])
        if isinstance(step, float):
            return step, rounds
        way, rank = step
    raise AssertionError("no end")


RANDOM = np.random.default_rng(5)
SETS = {
    "uniform": RANDOM.uniform(-1, 1, 60_000),
    "at rest": np.ones(50_000),
    "nearly at rest": 1.0 - 1e-13 * RANDOM.random(50_000),
    "two neighbours": np.where(RANDOM.random(50_000) < 0.5, 0.3, np.nextafter(0.3, 1.0)),
    "not finite": np.where(RANDOM.random(50_000) < 0.5, -np.inf, -1.0 + 1e-18 * RANDOM.random(50_000)),
    "ends": np.where(RANDOM.random(50_000) < 0.5, -1.0, 1.0),
    "around zero": 1e-200 * RANDOM.standard_normal(50_000),
}


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("machines", [1, 3])
def test_every_rank_is_found(name: str, machines: int) -> None:
    values = SETS[name]
    parts = np.array_split(values, machines)
    ordered = np.sort(values)
    for rank in (0, len(values) // 100, len(values) // 2, len(values) - 1):
        value, rounds = found(parts, rank)
        assert value == ordered[rank]
        assert rounds <= 8


@given(st.lists(st.floats(-1, 1), min_size=1, max_size=60), st.integers(1, 4), st.data())
def test_small_sets_take_one_round(values: list[float], machines: int, data: st.DataObject) -> None:
    rank = data.draw(st.integers(0, len(values) - 1))
    parts = [np.array(values[i::machines]) for i in range(machines)]
    assert found(parts, rank) == (sorted(values)[rank], 1)


def test_messages_do_not_grow_with_the_number_of_values() -> None:
    for way in (WHOLE, ((-1.0, 0.5 * BINS, 1500),)):
        found = content(RANDOM.uniform(-1, 1, 2_000_000), way)
        assert found.bins.nbytes + found.counts.nbytes <= 6 * BINS
        assert found.values is None or len(found.values) <= 2000


def test_counts_add_up() -> None:
    parts = np.array_split(SETS["uniform"], 4)
    np.testing.assert_array_equal(
        merged_counts([content(part, WHOLE) for part in parts]), merged_counts([content(SETS["uniform"], WHOLE)])
    )
