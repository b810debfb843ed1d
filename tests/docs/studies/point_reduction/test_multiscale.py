"""Kedward's multiscale interpolation: exact everywhere, and equal to the sequential system solved densely."""

import numpy as np
import pytest
from reduced_motions import problem

from docs.studies.thesis._point_reduction.farthest_first import farthest_first
from docs.studies.thesis._point_reduction.multiscale import class_radii, greedy_base, reduce
from docs.studies.thesis.section_2_2_reductions_compared import farthest_base

BASE_SETS = {"greedy": greedy_base, "farthest-first": farthest_base}


def wendland(r: np.ndarray) -> np.ndarray:
    return np.maximum(0.0, 1.0 - r) ** 4 * (4.0 * r + 1.0)


@pytest.mark.parametrize("base", BASE_SETS)
def test_a_class_at_a_time_is_the_dense_triangular_system(base: str) -> None:
    """The whole matrix, a node's own radius in its column, solved at once for all weights."""
    of = problem("slab", tolerance=1e-1)
    reduced = reduce(of, base=BASE_SETS[base])
    order, first = reduced.selected, len(reduced.levels[0].weights)
    radius = np.concatenate([np.full(len(level.weights), level.support_radius) for level in reduced.levels])
    x = of.points[order]
    matrix = wendland(np.linalg.norm(x[:, None] - x, axis=2) / radius)
    np.testing.assert_array_equal(np.triu(matrix[:, first:])[:first], 0.0)
    np.testing.assert_array_equal(np.triu(matrix[first:, first:]), np.eye(len(order) - first))
    weights = np.linalg.solve(matrix, of.displacement[order])
    found = np.concatenate([level.weights for level in reduced.levels])
    np.testing.assert_allclose(found, weights, atol=1e-11 * np.abs(weights).max())


def test_radii_are_separations_rounded_down() -> None:
    of = problem("wing")
    separation = farthest_first(of.points, np.array([of.start])).separation[1:]
    radii = class_radii(separation)
    assert (radii <= separation).all()
    assert (radii >= separation / np.sqrt(2) * (1 - 1e-12)).all()
    assert (np.diff(radii) <= 0.0).all()
    assert len(np.unique(radii)) <= 2 * np.log2(separation[0] / separation[-1]) + 2


def test_a_greedy_base_set_leaves_the_added_functions_little() -> None:
    """Weight divided by radius is the slope of a function, and steep slopes cost mesh quality."""
    of = problem("wing", tolerance=1e-3)
    steepest = {
        base: max(
            np.linalg.norm(level.weights, axis=1).max() / level.support_radius
            for level in reduce(of, base=BASE_SETS[base]).levels[1:]
        )
        for base in BASE_SETS
    }
    assert steepest["greedy"] < 0.05
    assert steepest["farthest-first"] > 0.3
