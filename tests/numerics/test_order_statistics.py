"""Percentiles and the smallest values are those of the sorted values, for any sample of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from mesh_motion_numerics.quality.quality_summary import (
    distribution,
    judged_mesh,
    percentile_ranks,
    smallest,
    summarize,
)
from thread_counts import on_one_and_on_all_threads

NEAR_ONE = st.integers(0, 2000).map(lambda k: 1.0 - k * 2.0**-53)
VALUES = st.lists(
    st.floats(-1, 1) | NEAR_ONE | st.sampled_from([-np.inf, -0.0, 0.0, 0.3, 1.0, 1.0 + 2.0**-52, -1.0]), min_size=1
)
RANDOM = np.random.default_rng(6)
MANY = 100_000  # enough to be sampled


def assert_exact(values: np.ndarray) -> None:
    """The results compared with those of a sort."""
    found, in_order = distribution(values), np.sort(values)
    assert [found.min, found.p1, found.p5, found.p50] == in_order[[0, *percentile_ranks(len(values))]].tolist()
    assert found.mean == pytest.approx(values.mean(), rel=1e-12, abs=1e-14)
    for count in (0, 1, 10, 3000):
        np.testing.assert_array_equal(smallest(values, count), np.argsort(values, kind="stable")[:count])


@given(values=VALUES)
def test_few_values(values):
    assert_exact(np.array(values))


@given(values=VALUES, seed=st.integers(0, 2**32 - 1), shares=st.integers(1, 8))
def test_many_values_of_few_kinds(values, seed, shares):
    rng = np.random.default_rng(seed)
    weights = rng.random(len(values)) ** shares
    assert_exact(rng.choice(np.array(values), MANY, p=weights / weights.sum()))


SETS = {
    "uniform": RANDOM.uniform(-1, 1, MANY),
    "ones": np.ones(MANY),
    "nearly ones": 1.0 - 1e-13 * RANDOM.random(MANY),
    "half ones": np.where(RANDOM.random(MANY) < 0.5, RANDOM.random(MANY), 1.0),
    "half ones in order": np.sort(np.where(np.arange(MANY) < MANY // 2, RANDOM.random(MANY), 1.0)),
    "ones except the worst": np.where(RANDOM.random(MANY) < 0.01, RANDOM.random(MANY), 1.0),
    "two neighbours": np.where(RANDOM.random(MANY) < 0.5, 0.3, np.nextafter(0.3, 1.0)),
    "not finite": np.where(RANDOM.random(MANY) < 0.04, -np.inf, RANDOM.random(MANY)),
    "around zero": 1e-200 * RANDOM.standard_normal(MANY),
    "ascending": np.linspace(-1.0, 1.0, MANY),
    "periodic": np.tile(np.linspace(-1.0, 1.0, 16), MANY // 16),
}


@pytest.mark.parametrize("name", SETS)
def test_many_values(name):
    assert_exact(SETS[name])


def sampled(m: int) -> np.ndarray:
    """Whether each of m values belongs to the first sample (kernels/src/quality/order_statistics.cpp)."""
    count = max(2048, min(m // 16, 16384))
    i = np.arange(count, dtype=np.uint64)
    x = (i + np.uint64(0x9E3779B97F4A7C15)) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ x >> np.uint64(27)) * np.uint64(0x94D049BB133111EB)
    x ^= x >> np.uint64(31)
    ends = np.arange(count + 1, dtype=np.uint64) * np.uint64(m) // np.uint64(count)
    out = np.zeros(m, dtype=bool)
    out[ends[:-1] + x % np.diff(ends)] = True
    return out


@pytest.mark.parametrize("other", [-1.0, 0.2, 0.5, 1.0])
def test_a_sample_that_misleads_costs_time_only(other):
    chosen = sampled(MANY)
    assert chosen.sum() == MANY // 16
    assert_exact(np.where(chosen, RANDOM.uniform(0.2, 0.5, MANY), other))
    assert_exact(np.where(chosen, other, RANDOM.uniform(0.2, 0.5, MANY)))


def test_a_sample_of_cells_that_misleads_costs_time_only():
    m = 40_000
    chosen = sampled(m)
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.8]])
    points = (corners + RANDOM.uniform(-0.1, 0.1, (m, 3, 2)) * chosen[:, None, None]).reshape(-1, 2)
    cells = CellTable.from_arrays({"triangle": np.arange(3 * m).reshape(-1, 3)})
    sizes = reference_sizes(np.tile(corners, (m, 1)), cells)
    assert judged_mesh(points, cells, sizes)[0] == summarize(cell_quality(points, cells, sizes), points, cells)
    values = cell_quality(points, cells, sizes).metric("size-skew")
    assert_exact(values)


def test_threads_do_not_matter():
    one, all_of_them = on_one_and_on_all_threads(lambda: [distribution(values) for values in SETS.values()])
    assert one == all_of_them
