"""The summary's numbers are those of the sorted values; the worst cells come in a fixed order."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.numerics.quality.mesh_summary import lowest_of, summarize
from mesh_motion_server.numerics.quality.metrics import cell_quality, reference_sizes
from mesh_motion_server.numerics.quality.quality_summary import distribution, smallest

VALUES = st.lists(
    st.sampled_from([-np.inf, -1.0, -0.5, -0.0, 0.0, 1e-9, 0.3, 0.3000001, 0.7, 1.0]) | st.floats(-1, 1), min_size=1
)


@given(values=VALUES)
def test_percentiles_are_order_statistics(values):
    values = np.array(values)
    found, in_order = distribution(values), np.sort(values)
    for name, percent in (("p1", 1), ("p5", 5), ("p50", 50)):
        assert getattr(found, name) == in_order[percent * (len(values) - 1) // 100]
    assert found.min == in_order[0]
    assert found.mean == pytest.approx(values.mean(), abs=1e-15)


@given(values=VALUES, count=st.integers(0, 12))
def test_the_smallest_come_worst_first_and_ties_by_number(values, count):
    values = np.array(values)
    np.testing.assert_array_equal(smallest(values, count), np.argsort(values, kind="stable")[:count])


def test_many_values():
    values = np.clip(np.random.default_rng(5).normal(0.6, 0.2, 300_000), -1, 1)
    found, in_order = distribution(values), np.sort(values)
    assert (found.p1, found.p5, found.p50) == (in_order[2999], in_order[14999], in_order[149999])
    assert found.mean == pytest.approx(values.mean(), rel=1e-13)
    np.testing.assert_array_equal(smallest(values, 100), np.argsort(values, kind="stable")[:100])


def test_a_summary_names_the_worst_cells():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [2.0, 0.0], [2.0, 1.0]])
    cells = CellTable.from_arrays({"triangle": np.array([[0, 1, 2], [0, 2, 3]]), "quad": np.array([[1, 4, 5, 2]])})
    moved = points.copy()
    moved[4, 0] = 0.5  # inverts a corner of the quad
    quality = cell_quality(moved, cells, reference_sizes(points, cells))
    summary = summarize(quality, moved, cells, metric="size-skew-product", worst=2)
    assert summary.metric_name == "size-skew-product"
    assert (summary.cells, summary.inverted) == (3, 1)
    assert summary.skew.min == 0.0
    assert summary.size.p50 == 1.0
    assert [cell.number for cell in summary.worst] == [2, 0]
    assert summary.worst[0].centre == (1.125, 0.5)
    assert summary.worst[0].value == 0.0
    assert summary.worst[1].size_skew == pytest.approx(3**0.5 / 2)
    assert summary.metric == distribution(quality.metric("size-skew-product"))
    named = {"size": summary.size, "skew": summary.skew, "size_skew": summary.size_skew, "metric": summary.metric}
    assert summary.reported == named
    lowest = lowest_of(quality, moved, cells, metric="size-skew-product")
    assert lowest.reported == {"metric": lowest.metric}
    with pytest.raises(InvalidInput, match="unknown quality metric"):
        summarize(quality, moved, cells, metric="angle")
