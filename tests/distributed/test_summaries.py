"""The summary of a mesh from those of its partitions."""

from dataclasses import replace

import numpy as np
import pytest
from box_meshes import box_mesh
from mesh_motion_numerics.distributed.counted_cells import CountedCells
from mesh_motion_numerics.distributed.summaries import joined
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import QUALITY_METRICS, cell_quality, cells_at_rest
from mesh_motion_numerics.quality.quality_summary import QualitySummary, summarize
from own_ranks import box_file

from mesh_motion_server.files.partitions import partitions


def in_partitions(kind: str, points: np.ndarray, count: int, metric: str) -> QualitySummary:
    file = box_file(kind, 10)
    numbers = {tuple(cell): number for number, cell in enumerate(c for of in file.cells.values() for c in of.tolist())}
    counted, parts = [], []
    for part in partitions(file, count):
        cells = CellTable.from_arrays(part.cells)
        one = CountedCells(cells, cells_at_rest(part.points, cells), metric)
        found = one.judge(points[part.global_ids])
        own = [numbers[tuple(part.global_ids[cell])] for block in cells for cell in block.nodes]
        counted.append(one)
        parts.append(replace(found, worst=tuple(replace(cell, number=own[cell.number]) for cell in found.worst)))

    def ask(questions):  # type: ignore[no-untyped-def]
        return list(zip(*(one.contents(questions) for one in counted), strict=True))

    return joined(parts, metric, ask)


def without_means(summary: QualitySummary) -> QualitySummary:
    names = ("metric", "size", "skew", "size_skew")
    return replace(summary, **{name: replace(getattr(summary, name), mean=0.0) for name in names})


@pytest.mark.parametrize("metric", QUALITY_METRICS)
@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize("kind", ["tetra", "quad + triangle"])
@pytest.mark.parametrize("shake", [0.0, 0.02, 0.1])
def test_it_is_that_of_the_whole_mesh(metric: str, count: int, kind: str, shake: float) -> None:
    mesh = box_mesh(kind, 10)
    points = mesh.points + shake * np.random.default_rng(2).standard_normal(mesh.points.shape)
    at_rest = cells_at_rest(mesh.points, mesh.cells)
    whole = summarize(cell_quality(points, mesh.cells, at_rest), points, mesh.cells, metric=metric)
    merged = in_partitions(kind, points, count, metric)
    assert without_means(merged) == without_means(whole)
    for name in ("metric", "size", "skew", "size_skew"):
        assert getattr(merged, name).mean == pytest.approx(getattr(whole, name).mean, abs=1e-14)


def test_a_position_that_is_not_finite_shows() -> None:
    mesh = box_mesh("quad", 10)
    points = mesh.points.copy()
    points[7] = np.nan
    whole = summarize(cell_quality(points, mesh.cells, mesh.sizes), points, mesh.cells)
    merged = in_partitions("quad", points, 3, "size-skew")
    assert merged.size_skew.min == merged.size_skew.mean == float("-inf")
    assert merged.inverted == whole.inverted > 0
    assert [cell.number for cell in merged.worst] == [cell.number for cell in whole.worst]
