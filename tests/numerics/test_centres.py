import numpy as np
import pytest
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.interpolant import Interpolant
from mesh_motion_numerics.interpolation.kernels import BASES
from mesh_motion_numerics.mesh.points import bounding_box, padded
from scipy.spatial import cKDTree

C2 = BASES["wendland-c2"]


def sums(layout, centres, weights, radius, places):
    """(n,) sums over the centres in the cells around places (n, d)."""
    return evaluation.displacement(Interpolant(centres, weights[:, None], C2, radius, layout), places)[:, 0]


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("radius", [0.02, 0.07, 0.2])
def test_every_centre_within_the_radius_is_visited(d, radius):
    rng = np.random.default_rng(d)
    centres = rng.random((600, d)) * [1.0, 0.3, 2.0][:d]
    layout = CentreLayout.build(centres, C2, radius)
    assert sorted(layout.order) == list(range(600))
    assert np.array_equal(layout.coordinates[:d].T, centres[layout.order])
    places = np.concatenate([centres[:100], rng.uniform(-0.5, 2.5, (100, d)), centres[:50] + radius / np.sqrt(d)])
    weights = rng.normal(size=600)
    xi = np.linalg.norm(places[:, None] - centres, axis=2) / radius
    expected = (np.maximum(1.0 - xi, 0.0) ** 4 * (4.0 * xi + 1.0)) @ weights
    np.testing.assert_allclose(sums(layout, centres, weights, radius, places), expected, atol=1e-12)


def test_points_far_away_and_not_finite_visit_nothing_and_break_nothing():
    centres = np.random.default_rng(0).random((500, 3))
    layout = CentreLayout.build(centres, C2, 0.05)
    assert not layout.is_direct
    places = np.array([[1e300, 0, 0], [-1e300, 1e300, 0], [np.inf, 0, 0], [0.5, -np.inf, 0.5], [5.0, 0.5, 0.5]])
    assert not sums(layout, centres, np.ones(500), 0.05, places).any()


def test_large_radius_and_global_bases_sum_directly():
    centres = np.random.default_rng(0).random((500, 2))
    assert CentreLayout.build(centres, C2, 1.0).is_direct
    assert CentreLayout.build(centres, BASES["tps"], 0.01).is_direct
    assert not CentreLayout.build(centres, C2, 0.05).is_direct
    assert CentreLayout.build(centres, C2, 1.0).fraction == 1.0


def test_a_tiny_radius_does_not_make_a_huge_grid():
    layout = CentreLayout.build(np.random.default_rng(0).random((100, 3)), C2, 1e-9)
    assert layout.starts.size <= 64 * 100 + 1


def test_one_centre_and_points_on_a_line():
    assert CentreLayout.build(np.zeros((1, 3)), C2, 0.1).n_centres == 1
    line = np.column_stack([np.linspace(0, 1, 200), np.zeros(200), np.zeros(200)])
    assert not CentreLayout.build(line, C2, 0.01).is_direct


@pytest.mark.parametrize("d", [1, 2, 3])
def test_points_out_of_reach_are_those_whose_sums_are_zero(d: int) -> None:
    """A point out of reach has no centre within R; no point within reach is missed, far away or at a rim."""
    rng = np.random.default_rng(d)
    centres = 0.3 + 0.2 * rng.random((60, d))
    layout = CentreLayout.build(centres, C2, 0.05)
    points = padded(np.vstack([rng.random((2000, d)), centres, 1e6 * rng.normal(size=(20, d))]))
    near = layout.within_reach(points)
    distance = cKDTree(padded(centres)).query(points)[0]
    assert set(np.flatnonzero(distance < 0.05)) <= set(near)
    assert len(near) < len(points)
    assert distance[near].max() <= 2 * np.sqrt(d) * 0.0501


def test_a_bounding_box_is_that_of_the_points() -> None:
    points = np.random.default_rng(1).normal(size=(50, 3))
    np.testing.assert_array_equal(bounding_box(points), [points.min(axis=0), points.max(axis=0)])
