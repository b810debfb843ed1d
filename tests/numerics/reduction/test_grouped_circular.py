"""The grouping-circular-based greedy algorithm."""

import numpy as np
import pytest
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.reduction import REDUCTIONS
from mesh_motion_numerics.reduction.grouped_circular import default_groups, reduce
from mesh_motion_numerics.reduction.growing_set import GrowingSet
from reduced_motions import problem

from docs.studies.thesis._point_reduction import greedy


@pytest.mark.parametrize("boundary", ["slab", "wing"])
def test_one_group_is_the_greedy_algorithm(boundary: str) -> None:
    """The algorithm chooses the same points as a full solution for every point, and makes a full solution at the
    end.
    """
    of = problem(boundary, tolerance=1e-3)
    offered, full = REDUCTIONS["greedy"](of), greedy.reduce(of)
    np.testing.assert_array_equal(offered.selected, full.selected)
    np.testing.assert_array_equal(offered.levels[0].weights, full.levels[0].weights)


def test_errors_cost_the_share_of_the_groups() -> None:
    of = problem("wing", tolerance=0.0, max_points=100)
    one, many = (reduce(of, groups=m).history[-2].error_operations for m in (1, 20))
    assert many == pytest.approx(one / 20, rel=0.1)


def test_every_iteration_looks_at_the_next_group() -> None:
    of = problem("wing", tolerance=0.0, max_points=50)
    chosen = reduce(of, groups=7).selected
    np.testing.assert_array_equal(np.diff(chosen[1:] % 7) % 7, np.ones(48))


def test_it_stops_only_after_a_whole_cycle_within_the_tolerance() -> None:
    of = problem("wing", tolerance=1e-2)
    reduced = reduce(of, groups=7)
    groups = [i for i in reduced.history[:-1] if i.points == len(reduced.selected)]
    assert len(groups) == 7
    assert all(i.max_error <= of.allowed_error for i in groups)


def test_the_number_of_groups_follows_the_number_of_nodes() -> None:
    assert [default_groups(n) for n in (3, 64, 640, 10**6)] == [1, 2, 20, 32]


def test_weights_of_a_growing_set_are_those_of_a_factorization() -> None:
    of = problem("wing")
    growing = GrowingSet(of)
    nodes = np.random.default_rng(0).permutation(of.n_points)[:150]
    for node in nodes:
        growing.append(int(node))
    expected = factorize(of.points[nodes], support_radius=of.support_radius).solve(of.displacement[nodes]).weights
    np.testing.assert_allclose(growing.weights, expected, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(growing.errors(nodes), 0.0, atol=1e-12)
