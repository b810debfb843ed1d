import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_motion_numerics.mesh.closest_point import FacetSet, are_within, nearest_within


def sampled(corners, points, n=60):
    """Distance of points to the facets, from a fine barycentric sampling: an upper bound close to the exact value."""
    steps = [s / n for s in range(n + 1)]
    if corners.shape[1] == 2:
        weights = np.array([[1 - t, t] for t in steps])
    else:
        weights = np.array([[1 - a - b, a, b] for a in steps for b in steps if a + b <= 1 + 1e-12])
    samples = np.einsum("sw,fwd->fsd", weights, corners).reshape(-1, corners.shape[2])
    return np.min(np.linalg.norm(points[:, None] - samples, axis=2), axis=1)


@pytest.mark.parametrize(("width", "d"), [(2, 2), (2, 3), (3, 3)])
def test_nothing_on_the_facets_is_nearer(width, d):
    rng = np.random.default_rng(width + d)
    corners = rng.random((30, width, d))
    corners[:10] = corners[:10, :1] + 0.01 * rng.standard_normal((10, width, d))  # of very different size
    points = rng.uniform(-0.5, 1.5, (200, d))
    closest = FacetSet(corners).closest(points)
    distance = np.linalg.norm(points - closest, axis=1)
    reference = sampled(corners, points)
    assert np.all(distance <= reference + 1e-12)
    assert np.all(reference - distance <= 0.03)  # the sampling's own resolution


def test_places_on_a_triangle():
    triangle = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    places = {
        (0.2, 0.3, 5.0): (0.2, 0.3, 0.0),  # above its inside
        (-1.0, -1.0, 1.0): (0.0, 0.0, 0.0),  # beyond each corner
        (3.0, -1.0, 0.0): (1.0, 0.0, 0.0),
        (-1.0, 3.0, 0.0): (0.0, 1.0, 0.0),
        (0.5, -2.0, 0.0): (0.5, 0.0, 0.0),  # beyond each side
        (-2.0, 0.5, 0.0): (0.0, 0.5, 0.0),
        (1.0, 1.0, 3.0): (0.5, 0.5, 0.0),
    }
    closest = FacetSet(triangle).closest(np.array(list(places)))
    assert np.allclose(closest, list(places.values()), rtol=0, atol=1e-15)


def test_facets_without_extent():
    needle = np.array([[[0.0, 0, 0], [1, 0, 0], [0.5, 0, 0]], [[2.0, 2, 2], [2, 2, 2], [2, 2, 2]]])
    closest = FacetSet(needle).closest(np.array([[0.7, 1.0, 0.0], [3.0, 3.0, 3.0]]))
    assert np.allclose(closest, [[0.7, 0, 0], [2, 2, 2]], rtol=0, atol=1e-15)


@given(seed=st.integers(0, 500))
def test_the_closest_point_is_its_own_closest_point(seed):
    rng = np.random.default_rng(seed)
    facets = FacetSet(rng.random((12, 3, 3)))
    once = facets.closest(rng.random((9, 3)) * 3 - 1)
    assert np.allclose(facets.closest(once), once, rtol=0, atol=1e-14)


def test_no_point():
    assert FacetSet(np.zeros((1, 2, 2))).closest(np.empty((0, 2))).shape == (0, 2)


@pytest.mark.parametrize(("width", "d"), [(2, 2), (2, 3), (3, 3)])
def test_facets_of_any_size_are_found_within_a_distance(width, d):
    rng = np.random.default_rng(5)
    sizes = 10.0 ** rng.uniform(-3.0, 1.0, (40, 1, 1))
    corners = rng.uniform(-1.0, 1.0, (40, 1, d)) + sizes * rng.uniform(-1.0, 1.0, (40, width, d))
    points = rng.uniform(-3.0, 3.0, (200, d))
    places, facets = FacetSet(corners).nearest(points)
    away = np.linalg.norm(places - points, axis=1)
    for distance in (0.1, 0.5, np.inf):
        near, rows = nearest_within(corners, points, distance)
        found = rows >= 0
        assert np.array_equal(found, away <= distance)
        assert np.array_equal(are_within(corners, points, distance), found)
        assert np.isnan(near[~found]).all()
        assert np.allclose(near[found], places[found], atol=1e-12)
        assert np.allclose(np.linalg.norm(near[found] - points[found], axis=1), away[found], atol=1e-14)
        assert np.count_nonzero(rows[found] != facets[found]) <= 2  # equally near ones, at a shared corner


def test_no_facet_is_near_where_there_is_none():
    places, facets = nearest_within(np.empty((0, 2, 2)), np.zeros((3, 2)), 1.0)
    assert np.isnan(places).all()
    assert (facets == -1).all()
    assert not are_within(np.empty((0, 2, 2)), np.zeros((3, 2)), 1.0).any()
