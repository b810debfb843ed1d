"""Outside the box no bit changes, and the box stays the same during the iterations of a step."""

from dataclasses import replace

import numpy as np
import pytest
from volume_problems import problem_of

from docs.studies.thesis._volume_reduction.enclosing_box import BoxField, box_surface, reduce


@pytest.mark.parametrize(("d", "count"), [(1, 2), (2, 16), (3, 98)])
def test_the_surface_is_sampled_once(d: int, count: int) -> None:
    points = box_surface(-np.ones(d), np.ones(d), 1 if d == 1 else 4)
    assert len(points) == len(np.unique(points, axis=0)) == count
    assert (np.abs(points).max(axis=1) == 1.0).all()


@pytest.mark.parametrize("d", [2, 3])
def test_nodes_outside_rest_bitwise_and_the_field_fades_out_at_the_surface(d: int) -> None:
    problem = problem_of(d, length=0.4)
    field = reduce(problem)
    assert isinstance(field, BoxField)
    np.testing.assert_allclose([field.low, field.high], [[-0.5] * d, [0.5] * d])
    outside = np.abs(problem.nodes).max(axis=1) >= 0.5
    found = field(problem.nodes)
    assert np.array_equal(problem.nodes[outside] + found.displacement[outside], problem.nodes[outside])
    just_inside = box_surface(field.low, field.high, 20) * (1.0 - 1e-4)
    assert np.abs(field(just_inside).displacement).max() < 1e-6


def test_walls_within_the_box_are_control_points() -> None:
    problem = problem_of(length=2.0)
    assert np.abs(reduce(problem)(problem.boundary).displacement[~problem.moving]).max() < 1e-12


def test_the_same_control_points_serve_the_iterations_of_a_step() -> None:
    problem = problem_of(shift=0.18)
    used = []

    def noting(points, values):
        used.append(points)
        return problem.interpolate(points, values)

    for scale in (1.0, 0.98, 1.03):
        reduce(replace(problem, displacement=scale * problem.displacement, interpolate=noting))
    assert np.array_equal(used[0], used[1])
    assert np.array_equal(used[0], used[2])
