"""One pass over a mesh gives bitwise the summary of its stored qualities, on any number of threads."""

import numpy as np
import pytest
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import QUALITY_METRICS, cell_quality, cells_at_rest, reference_sizes
from mesh_motion_numerics.quality.quality_summary import distribution, judged_mesh, summarize
from mesh_motion_protocol.errors import InvalidInput
from thread_counts import on_one_and_on_all_threads
from tiny_meshes import tiny_meshes

MESHES = dict(tiny_meshes(6))


def shaken(points: np.ndarray, size: float, seed: int = 0) -> np.ndarray:
    return points + np.random.default_rng(seed).uniform(-size, size, points.shape)


@pytest.mark.parametrize("metric", QUALITY_METRICS)
@pytest.mark.parametrize("name", MESHES)
def test_the_numbers_are_those_of_all_cells(name, metric):
    points, cells = MESHES[name]
    sizes = cells_at_rest(points, cells)
    for size in (0.0, 1e-12, 1e-3, 0.05, 0.2):
        moved = shaken(points, size)
        expected = summarize(cell_quality(moved, cells, sizes), moved, cells, metric=metric, worst=7)
        assert judged_mesh(moved, cells, sizes, metric=metric, worst=7)[0] == expected


def test_blocks_of_several_types_are_numbered_through():
    parts = [MESHES[name] for name in ("tetra", "hexahedron", "wedge", "pyramid")]
    starts = np.cumsum([0, *(len(points) for points, _ in parts)])
    points = np.concatenate([points for points, _ in parts])
    blocks = [mesh.blocks[0] for _, mesh in parts]
    cells = CellTable.from_arrays({b.type.name: b.nodes + start for b, start in zip(blocks, starts, strict=False)})
    sizes, moved = reference_sizes(points, cells), shaken(points, 0.04)
    expected = summarize(cell_quality(moved, cells, sizes), moved, cells, worst=500)
    assert judged_mesh(moved, cells, sizes, worst=500)[0] == expected
    assert judged_mesh(moved, cells, sizes, worst=500, distributions=False)[0].worst == expected.worst
    assert len({cells.locate(cell.number)[0].type.name for cell in expected.worst}) > 1


def test_threads_do_not_matter():
    points, cells = MESHES["triangle"]
    many = CellTable.from_arrays({"triangle": np.tile(cells.blocks[0].nodes, (400, 1))})
    sizes, moved = reference_sizes(points, many), shaken(points, 0.03)
    one, all_of_them = on_one_and_on_all_threads(lambda: judged_mesh(moved, many, sizes)[0])
    assert one == all_of_them


def test_a_summary_names_the_worst_cells():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [2.0, 0.0], [2.0, 1.0]])
    cells = CellTable.from_arrays({"triangle": np.array([[0, 1, 2], [0, 2, 3]]), "quad": np.array([[1, 4, 5, 2]])})
    moved = points.copy()
    moved[4, 0] = 0.5  # inverts a corner of the quad
    quality = cell_quality(moved, cells, reference_sizes(points, cells))
    summary = summarize(quality, moved, cells, metric="size-skew-product", worst=2)
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
    lowest = summarize(quality, moved, cells, metric="size-skew-product", distributions=False)
    assert lowest.reported == {"metric": lowest.metric}
    with pytest.raises(InvalidInput, match="unknown quality metric"):
        summarize(quality, moved, cells, metric="angle")
    with pytest.raises(InvalidInput, match="unknown quality metric"):
        judged_mesh(moved, cells, reference_sizes(points, cells), metric="angle")
