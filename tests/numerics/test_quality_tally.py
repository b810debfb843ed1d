"""Levels ascend with the values, finest near 1; ranks are found from them."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mesh_motion_server.numerics.quality_tally import BINS, Tally

NEAR_ONE = st.integers(0, 2000).map(lambda k: 1.0 - k * 2.0**-53)
VALUES = st.lists(st.floats(-1, 1) | NEAR_ONE | st.sampled_from([-np.inf, 1.0, 1.0 + 2.0**-52, -1.0]), min_size=1)


@settings(max_examples=100, deadline=None)
@given(values=VALUES)
def test_levels_ascend_with_the_values(values):
    in_order = np.sort(values)
    assert np.all(np.diff(Tally.of(in_order).levels.astype(int)) >= 0)


def test_levels_cover_all_values():
    ends = Tally.of(np.array([-np.inf, -1.0, 1.0]))
    assert ends.levels[0] == ends.levels[1]
    assert (ends.counts[:, 0].sum(), ends.counts[:, BINS - 1].sum()) == (2, 1)
    near = Tally.of(1.0 - np.arange(30) * 2.0**-53)
    assert len(np.unique(near.levels)) == 30


@settings(max_examples=100, deadline=None)
@given(values=VALUES, data=st.data())
def test_ranks_are_those_of_the_sorted_values(values, data):
    values = np.array(values)
    ranks = data.draw(st.lists(st.integers(0, len(values) - 1), min_size=1, max_size=3))
    ranked = Tally.of(values).at_ranks(ranks)
    assert ranked.found(values[ranked.numbers]) == np.sort(values)[ranks].tolist()


def test_few_values_are_looked_at():
    values = np.clip(1.0 - np.abs(np.random.default_rng(2).normal(0.0, 1e-9, 200_000)), -1, 1)
    assert len(Tally.of(values).at_ranks([1999, 9999, 99_999]).numbers) < 1000
    at_rest = np.ones(1000)
    at_rest[3] = 0.5
    assert len(Tally.of(at_rest).at_ranks([10, 50, 500]).numbers) == 0


def test_ranks_among_ones_beside_ranks_below_them():
    values = np.concatenate([np.full(4, 0.1), np.full(6, 0.2), np.full(1000, 1.0 - 2.0**-53), np.ones(9000)])
    ranked = Tally.of(values).at_ranks([3, 9, 5000])
    assert ranked.found(values[ranked.numbers]) == [0.1, 0.2, 1.0]
