import numpy as np
import pytest
from mesh_motion_numerics.interpolation.factorizations.thinning import nearest_preceding, nested_levels
from scipy.spatial import cKDTree


@pytest.mark.parametrize("d", [1, 2, 3])
def test_levels_hold_every_point_once_and_grow_finer(d):
    points = np.random.default_rng(d).random((2000, d))
    levels = nested_levels(points)
    assert sorted(np.concatenate(levels).tolist()) == list(range(2000))
    covered = [cKDTree(points[np.concatenate(levels[: i + 1])]).query(points)[0].max() for i in range(len(levels))]
    for level, farthest in enumerate(covered):
        assert farthest <= 2.0**-level * np.sqrt(d) * 1.0001  # a cell's diagonal


def test_points_much_closer_than_2_to_the_minus_48_end_up_in_the_last_level():
    points = np.array([[0.0], [1e-20], [2e-20], [1.0]])
    levels = nested_levels(points)
    assert sorted(np.concatenate(levels).tolist()) == [0, 1, 2, 3]


def test_neighbours_precede_and_are_the_nearest_that_do():
    points = np.random.default_rng(0).random((800, 3))
    order, near = nearest_preceding(points, nested_levels(points), 16)
    assert sorted(order.tolist()) == list(range(800))
    placed = points[order]
    for rank in range(800):
        found = near[rank][near[rank] >= 0]
        assert (found < rank).all()
        assert len(set(found.tolist())) == len(found)
        distance = np.linalg.norm(placed[:rank] - placed[rank], axis=1)
        # the search looks at 33 places around: the nearest few preceding ones are always among them, in order
        assert np.all(np.diff(distance[found]) >= 0)
        if rank and len(found):
            assert distance[found[0]] == distance.min()
    assert np.count_nonzero(near[400:, 5] < 0) == 0
