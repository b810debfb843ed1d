"""Clustering on a hierarchy of grids."""

import numpy as np
import pytest
from mesh_motion_numerics.interpolation.interpolant import factorize
from reduced_motions import problem

from docs.studies.thesis._point_reduction.grid_clustering import Clusters, reduce

POINTS = np.random.default_rng(3).random((400, 3))
ALL = np.ones(400, dtype=bool)


def test_clusters_are_the_cells_of_a_grid() -> None:
    clusters = Clusters(POINTS)
    clusters.divide(ALL)
    clusters.divide(ALL)
    low, extent = POINTS.min(axis=0), np.ptp(POINTS, axis=0).max()
    cells = np.minimum(np.floor(4 * (POINTS - low) / extent), 3)
    assert clusters.count == len(np.unique(cells, axis=0))
    for label in range(clusters.count):
        assert len(np.unique(cells[clusters.label == label], axis=0)) == 1


def test_the_representative_is_nearest_to_the_centroid_unless_one_was_selected() -> None:
    clusters = Clusters(POINTS)
    clusters.divide(ALL)
    plain = clusters.representatives(np.empty(0, dtype=np.int64))
    for label, node in enumerate(plain):
        members = POINTS[clusters.label == label]
        away = np.linalg.norm(members - members.mean(axis=0), axis=1)
        assert np.linalg.norm(POINTS[node] - members.mean(axis=0)) == pytest.approx(away.min())
    kept = np.flatnonzero(clusters.label == 2)[-1:]
    again = clusters.representatives(kept)
    assert again[2] == kept[0]
    np.testing.assert_array_equal(np.delete(again, 2), np.delete(plain, 2))


def test_it_is_the_interpolation_from_the_representatives() -> None:
    of = problem("wing", tolerance=1e-2)
    reduced = reduce(of)
    nodes = reduced.selected
    expected = factorize(of.points[nodes], support_radius=of.support_radius).solve(of.displacement[nodes])
    (level,) = reduced.levels
    np.testing.assert_allclose(level.weights, expected.weights)
