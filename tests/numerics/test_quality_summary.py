"""The summary's numbers are those of the sorted values; the worst cells come in a fixed order."""

import numpy as np
import pytest
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.mesh_summary import lowest_of, summarize
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from mesh_motion_numerics.quality.quality_summary import distribution
from mesh_motion_protocol.errors import InvalidInput


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
