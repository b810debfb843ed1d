"""A partition's counts of one pass over its cells are those of all the cells' values."""

import numpy as np
import pytest
from box_meshes import box_mesh
from mesh_motion_numerics.distributed.counted_cells import CountedCells
from mesh_motion_numerics.distributed.order_statistics import BINS, WHOLE, BinContent, Way, content
from mesh_motion_numerics.quality.metrics import QUALITY_METRICS, cell_quality, cells_at_rest
from mesh_motion_numerics.quality.quality_summary import reported_metrics

MESHES = {"few": ("quad", 8), "tetrahedra": ("tetra", 8), "two types": ("quad + triangle", 24)}
SHAKES = {"at rest": 0.0, "hardly": 1e-9, "some": 0.02, "wild": 0.3, "not finite": np.nan}


def moved(points: np.ndarray, shake: float) -> np.ndarray:
    found = points + (0.02 if np.isnan(shake) else shake) * np.random.default_rng(1).standard_normal(points.shape)
    found[7] += 0.0 * shake
    return found


def ways(values: np.ndarray) -> list[Way]:
    """Bins that have some of the values, the fullest and the emptiest part of each, and again of those."""
    found: list[Way] = [WHOLE]
    for way in found:
        low, scale = (-1.0, 0.5 * BINS) if way == WHOLE else (way[-1][0] + way[-1][2] / way[-1][1], way[-1][1] * BINS)
        if len(way) < 3:
            here = content(values, way)
            chosen = here.bins if way == WHOLE else here.bins[[here.counts.argmax(), here.counts.argmin()]]
            found += [(*way, (low, scale, int(bin_))) for bin_ in np.unique(chosen)[::7]]
    return found


def as_lists(one: BinContent) -> list[object]:
    return [None if part is None else part.tolist() for part in (one.bins, one.counts, one.values, one.repeated)]


@pytest.mark.parametrize("metric", QUALITY_METRICS)
@pytest.mark.parametrize("shake", SHAKES)
@pytest.mark.parametrize("kind", MESHES)
def test_bins_are_those_of_all_values(kind: str, shake: str, metric: str) -> None:
    mesh = box_mesh(*MESHES[kind])
    at_rest = cells_at_rest(mesh.points, mesh.cells)
    counted = CountedCells(mesh.cells, at_rest, metric)
    for points in (mesh.points + 0.01 * mesh.points[:, ::-1] ** 2, moved(mesh.points, SHAKES[shake])):
        part, quality = counted.judge(points), cell_quality(points, mesh.cells, at_rest)
        assert part.inverted == np.count_nonzero(quality.inverted)
        for name in reported_metrics(metric):
            values = quality.metric(name)
            assert part.minima[name] == values.min()
            assert part.sums[name] == pytest.approx(values.sum(), rel=1e-14)
            asked = [(name, way) for way in ways(values)]
            for (_, way), found in zip(asked, counted.contents(asked), strict=True):
                assert as_lists(found) == as_lists(content(values, way))
        assert [cell.value for cell in part.worst] == np.sort(quality.metric(metric))[:10].tolist()
