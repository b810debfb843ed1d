"""The restriction leaves the wall's neighbourhood alone and ends at D."""

import numpy as np
import pytest
from volume_problems import problem_of

from docs.studies.thesis._volume_reduction.wall_function import WallFunctionField, reduce, restriction


def test_the_function_and_its_slope_are_those_of_a_step_at_both_ends() -> None:
    assert restriction(np.array([0.0, 0.5, 1.0, 7.0])).tolist() == [1.0, 0.5, 0.0, 0.0]
    h = 1e-5
    assert (1.0 - restriction(np.array([h])))[0] < 4 * h**2
    assert restriction(np.array([1.0 - h]))[0] < 4 * h**2
    assert (np.diff(restriction(np.linspace(0, 1, 100))) < 0).all()


@pytest.mark.parametrize("d", [1, 2, 3])
def test_it_is_the_standard_field_times_the_function(d: int) -> None:
    problem = problem_of(d, length=0.3)
    field = reduce(problem)
    found = field(problem.nodes)
    body = problem.boundary[problem.moving]
    distance = np.linalg.norm(problem.nodes[:, None] - body, axis=2).min(axis=1)
    expected = restriction(distance / 0.3)[:, None] * problem.standard(problem.nodes)
    np.testing.assert_allclose(found.displacement, expected, atol=1e-14)
    assert np.array_equal(found.evaluated, distance < 0.3)
    assert np.array_equal(
        problem.nodes[distance >= 0.3] + found.displacement[distance >= 0.3], problem.nodes[distance >= 0.3]
    )


def test_the_distance_follows_the_motion_but_not_below_the_body_s_size() -> None:
    small, large = reduce(problem_of(shift=0.001)), reduce(problem_of(shift=0.2))
    assert isinstance(small, WallFunctionField)
    assert isinstance(large, WallFunctionField)
    assert small.distance == pytest.approx(1.5 * 0.2)
    assert large.distance == pytest.approx(6.0 * np.hypot(0.2, 0.2))
