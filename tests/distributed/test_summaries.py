"""The summary of a mesh from those of its partitions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from box_meshes import box_mesh

from mesh_motion_server.distributed.held import HeldPartition, Positions, judge, questioned
from mesh_motion_server.distributed.split import Split
from mesh_motion_server.distributed.summaries import joined
from mesh_motion_server.numerics.quality.mesh_summary import summarize
from mesh_motion_server.numerics.quality.metrics import QUALITY_METRICS, cell_quality, cells_at_rest
from mesh_motion_server.numerics.quality.quality_summary import QualitySummary


def in_partitions(mesh, points: np.ndarray, count: int, metric: str) -> QualitySummary:  # type: ignore[no-untyped-def]
    split = Split.build(mesh.points, mesh.cells, count)
    held = [HeldPartition(split.partition(number)) for number in range(count)]
    parts = [judge(one, Positions(None, None, points[one.mesh.nodes]), 1, metric, ())[0] for one in held]

    def ask(questions):  # type: ignore[no-untyped-def]
        return list(zip(*(questioned(one, questions, None, 2, metric, ()) for one in held), strict=True))

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
    merged = in_partitions(mesh, points, count, metric)
    assert without_means(merged) == without_means(whole)
    for name in ("metric", "size", "skew", "size_skew"):
        assert getattr(merged, name).mean == pytest.approx(getattr(whole, name).mean, abs=1e-14)


def test_a_position_that_is_not_finite_shows() -> None:
    mesh = box_mesh("quad", 10)
    points = mesh.points.copy()
    points[7] = np.nan
    whole = summarize(cell_quality(points, mesh.cells, mesh.sizes), points, mesh.cells)
    merged = in_partitions(mesh, points, 3, "size-skew")
    assert merged.size_skew.min == merged.size_skew.mean == float("-inf")
    assert merged.inverted == whole.inverted > 0
    assert [cell.number for cell in merged.worst] == [cell.number for cell in whole.worst]
