"""The worst cells computed without the distributions are those of the full summary, for any motion."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_motion_numerics.mesh.cells import CELL_TYPES, CellTable
from mesh_motion_numerics.quality.metrics import (
    QUALITY_METRICS,
    CellsAtRest,
    cell_quality,
    cells_at_rest,
    corner_quality,
    reference_sizes,
)
from mesh_motion_numerics.quality.quality_summary import judged_mesh, summarize
from thread_counts import on_one_and_on_all_threads
from tiny_meshes import tiny_mesh, tiny_meshes

MESHES = dict(tiny_meshes(6))
TETRA = tiny_mesh("tetra", 12)
RELATIVE = "relative-size-skew"


def assert_same(points: np.ndarray, cells: CellTable, sizes: np.ndarray, metric: str = "size-skew") -> None:
    found, full = (judged_mesh(points, cells, sizes, metric=metric, distributions=all_)[0] for all_ in (False, True))
    assert (found.metric.min, found.inverted, found.cells) == (full.metric.min, full.inverted, full.cells)
    assert repr(found.worst) == repr(full.worst)
    of_all = summarize(cell_quality(points, cells, sizes), points, cells, metric=metric, distributions=False)
    assert repr(of_all) == repr(found)


@pytest.mark.parametrize("metric", QUALITY_METRICS)
@pytest.mark.parametrize("name", MESHES)
def test_every_cell_type_and_metric(name, metric):
    points, cells = MESHES[name]
    sizes = cells_at_rest(points, cells)
    for seed, size in enumerate((0.0, 1e-9, 0.02, 0.1)):
        moved = points + np.random.default_rng(seed).uniform(-size, size, points.shape)
        assert_same(moved, cells, sizes, metric)


@pytest.mark.parametrize("distributions", [True, False])
@pytest.mark.parametrize("name", MESHES)
def test_cells_whose_worst_corner_is_below_a_limit_are_found_in_the_same_pass(name, distributions):
    points, cells = MESHES[name]
    rest, choices = cells_at_rest(points, cells), {"metric": RELATIVE, "distributions": distributions}
    for seed, size in enumerate((0.0, 0.02, 0.1, 0.3)):
        moved = points + np.random.default_rng(seed).uniform(-size, size, points.shape)
        quality, none = judged_mesh(moved, cells, rest, **choices)
        assert not len(none)
        values = corner_quality(moved, cells, points)
        for limit in (1e-9, np.median(values), 1.0 + 1e-9):
            again, found = judged_mesh(moved, cells, rest, **choices, limit=limit)
            assert repr(again) == repr(quality)
            np.testing.assert_array_equal(found, np.flatnonzero(values < limit))


@given(
    seed=st.integers(0, 2**32 - 1),
    sizes=st.tuples(st.floats(0.0, 0.06), st.floats(0.0, 0.03)),
    scale=st.sampled_from([1.0, 1e-30, 1e30, 1e-120]),
)
def test_pairs_of_motions_of_many_tetrahedra(seed, sizes, scale):
    rng = np.random.default_rng(seed)
    points, cells = TETRA
    for size in sizes:  # the second from the first, as a later coupling iteration is
        where = rng.random(3)
        near = np.exp(-((points - where) ** 2).sum(axis=1)[:, None] / 0.05)
        points = points + size * near * rng.uniform(-1, 1, points.shape)
        assert_same(scale * points, cells, reference_sizes(scale * TETRA[0], cells))
        if scale > 1e-100:  # smaller cells have no skew that could be divided by
            assert_same(scale * points, cells, cells_at_rest(scale * TETRA[0], cells), "relative-size-skew")


@given(seed=st.integers(0, 2**32 - 1), stretch=st.floats(1.0, 3.0), metric=st.sampled_from(["size-skew", RELATIVE]))
def test_no_cell_at_or_below_the_limit_is_passed_over(seed, stretch, metric):
    rng = np.random.default_rng(seed)
    kinds, m = 9, 20_000  # few values for many cells: whatever is looked at first, the limit is one of them
    edges = np.eye(3) + rng.uniform(-0.4, 0.4, (kinds, 3, 3))
    reference = np.abs(np.linalg.det(edges)) * rng.uniform(1 / stretch, stretch, kinds)
    points = np.concatenate([np.zeros((kinds, 1, 3)), edges.transpose(0, 2, 1)], axis=1).reshape(-1, 3)
    kind = rng.integers(0, kinds, m)
    cells = CellTable.from_arrays({"tetra": 4 * kind[:, None] + np.arange(4)})
    rest = CellsAtRest(reference[kind], rng.uniform(0.2, 1.0, kinds)[kind], points)
    values = cell_quality(points, cells, rest).metric(metric)
    expected = np.argsort(values, kind="stable")
    for count in (1, 10, 4000):
        found = judged_mesh(points, cells, rest, metric=metric, worst=count, distributions=False)[0]
        assert [cell.number for cell in found.worst] == expected[:count].tolist()
        assert found.inverted == np.count_nonzero(cell_quality(points, cells, rest).inverted)


def test_equal_cells_are_named_in_order():
    points, cells = TETRA
    same = CellTable.from_arrays({"tetra": np.tile(cells.blocks[0].nodes[:1], (3000, 1))})
    found = judged_mesh(1.1 * points, same, reference_sizes(points, same), distributions=False)[0]
    assert [cell.number for cell in found.worst] == list(range(10))


def test_positions_that_are_no_numbers_and_few_cells():
    points, cells = TETRA
    sizes, moved = reference_sizes(points, cells), points.copy()
    moved[100, 1], moved[900, 0] = np.nan, np.inf
    assert_same(moved, cells, sizes)
    few = CellTable.from_arrays({"tetra": cells.blocks[0].nodes[:3]})
    assert_same(points, few, reference_sizes(points, few))


def test_threads_do_not_matter():
    points, cells = TETRA
    moved = points + np.random.default_rng(3).uniform(-0.02, 0.02, points.shape)
    sizes = reference_sizes(points, cells)
    one, all_of_them = on_one_and_on_all_threads(lambda: judged_mesh(moved, cells, sizes, distributions=False)[0])
    assert one == all_of_them


def test_every_cell_type_is_here():
    assert set(MESHES) == set(CELL_TYPES)
