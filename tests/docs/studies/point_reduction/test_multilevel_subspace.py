"""The multilevel subspace method and its double-edged greedy choice."""

import numpy as np
import pytest
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.reduction import ReductionProblem
from reduced_motions import problem

from docs.studies.thesis._point_reduction.multilevel_subspace import reduce


def test_every_level_interpolates_what_those_before_it_left() -> None:
    of = problem("wing", tolerance=1e-2)
    reduced = reduce(of, points_per_level=30)
    assert len(reduced.levels) > 2
    place = {tuple(x): i for i, x in enumerate(of.points)}
    left = of.displacement.copy()
    for level in reduced.levels:
        nodes = np.array([place[tuple(x)] for x in level.control_points])
        assert len(nodes) <= 30
        expected = factorize(of.points[nodes], support_radius=of.support_radius).solve(left[nodes])
        np.testing.assert_allclose(level.weights, expected.weights, atol=1e-10 * np.abs(expected.weights).max())
        left -= of.values(level)
        assert np.abs(left[nodes]).max() <= 1e-12
    assert np.linalg.norm(left, axis=1).max() <= of.allowed_error


def test_two_points_a_step_are_the_largest_error_and_the_most_opposed_one() -> None:
    points = np.linspace(0.0, 10.0, 11)[:, None]
    displacement = np.zeros((11, 2))
    displacement[[2, 5, 8, 9]] = [[3.0, 0.0], [0.0, 2.9], [-1.0, 0.0], [-0.5, 2.0]]
    of = ReductionProblem(points, displacement, support_radius=0.5)  # nodes do not feel each other
    assert list(reduce(of).selected) == [2, 8, 5, 9]


def test_levels_that_would_hold_all_nodes_give_way_to_the_plain_interpolation() -> None:
    of = problem("slab", tolerance=1e-12)
    reduced = reduce(of, points_per_level=10)
    assert len(reduced.levels) == 1
    full = factorize(of.points, support_radius=of.support_radius).solve(of.displacement)
    np.testing.assert_allclose(reduced.levels[0].weights, full.weights)


@pytest.mark.parametrize("points_per_level", [8, 30])
def test_a_bound_counts_the_control_points_of_all_levels(points_per_level: int) -> None:
    reduced = reduce(problem("wing", tolerance=1e-9, max_points=75), points_per_level=points_per_level)
    assert sum(len(level.weights) for level in reduced.levels) == 75
