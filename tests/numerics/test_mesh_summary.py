"""One pass over a mesh says what the summary of its stored qualities says, bitwise, on any number of threads."""

import numpy as np
import pytest
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.mesh_summary import mesh_summary, summarize
from mesh_motion_numerics.quality.metrics import QUALITY_METRICS, cell_quality, cells_at_rest, reference_sizes
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
        assert mesh_summary(moved, cells, sizes, metric=metric, worst=7) == expected


def test_blocks_of_several_types_are_numbered_through():
    parts = [MESHES[name] for name in ("tetra", "hexahedron", "wedge", "pyramid")]
    starts = np.cumsum([0, *(len(points) for points, _ in parts)])
    points = np.concatenate([points for points, _ in parts])
    blocks = [mesh.blocks[0] for _, mesh in parts]
    cells = CellTable.from_arrays({b.type.name: b.nodes + start for b, start in zip(blocks, starts, strict=False)})
    sizes, moved = reference_sizes(points, cells), shaken(points, 0.04)
    expected = summarize(cell_quality(moved, cells, sizes), moved, cells, worst=500)
    assert mesh_summary(moved, cells, sizes, worst=500) == expected
    assert len({cells.locate(cell.number)[0].type.name for cell in expected.worst}) > 1


def test_threads_do_not_matter():
    points, cells = MESHES["triangle"]
    many = CellTable.from_arrays({"triangle": np.tile(cells.blocks[0].nodes, (400, 1))})
    sizes, moved = reference_sizes(points, many), shaken(points, 0.03)
    one, all_of_them = on_one_and_on_all_threads(lambda: mesh_summary(moved, many, sizes))
    assert one == all_of_them


def test_an_unknown_metric_is_refused():
    points, cells = MESHES["quad"]
    with pytest.raises(InvalidInput, match="unknown quality metric"):
        mesh_summary(points, cells, reference_sizes(points, cells), metric="angle")
