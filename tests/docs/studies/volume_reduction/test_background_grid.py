"""Grid interpolation: exact for its polynomials, of its order for smooth functions, direct near control points."""

from dataclasses import replace

import numpy as np
import pytest
from volume_problems import problem_of

from docs.studies.thesis._volume_reduction.background_grid import CartesianGrid, GridField, reduce


def interpolated(grid: CartesianGrid, function, points: np.ndarray) -> np.ndarray:
    places = grid.places(points)
    numbers = grid.asked(places)
    return grid.interpolate(places, numbers, function(grid.points(numbers, points.shape[1])))


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize(("interpolation", "degree"), [("linear", 1), ("cubic", 3)])
def test_its_polynomials_are_exact(d: int, interpolation: str, degree: int) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-2.0, 1.0, (300, d))
    powers = rng.integers(0, degree + 1, (5, d))
    function = lambda x: np.prod(x[:, None, :] ** powers, axis=2)  # noqa: E731
    grid = CartesianGrid.around(points, 0.3, interpolation)
    np.testing.assert_allclose(interpolated(grid, function, points), function(points), atol=1e-11)


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize(("interpolation", "order"), [("linear", 2), ("cubic", 4)])
def test_a_smooth_function_is_approached_at_the_order(d: int, interpolation: str, order: int) -> None:
    points = np.random.default_rng(1).random((2000, d))
    function = lambda x: np.sin(3.0 * x.sum(axis=1))[:, None]  # noqa: E731
    errors = [
        np.abs(interpolated(CartesianGrid.around(points, h, interpolation), function, points) - function(points)).max()
        for h in (0.1, 0.05)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.25)


@pytest.mark.parametrize("d", [2, 3])
def test_near_control_points_the_field_is_the_standard_one_bitwise(d: int) -> None:
    problem = problem_of(d, length=0.125, n=5)
    field = reduce(problem)
    found, standard = field(problem.nodes), problem.standard(problem.nodes)
    distance = np.linalg.norm(problem.nodes[:, None] - problem.boundary, axis=2).min(axis=1)
    near = distance < 2.0 * 0.125
    assert np.array_equal(found.displacement[near], standard[near])
    assert np.array_equal(found.evaluated, distance < 3.0 * 0.125)
    assert 0.0 < np.abs(found.displacement - standard).max() < 2e-3 * problem.largest


def test_the_blend_leaves_no_jump() -> None:
    problem = problem_of(2, length=0.125, n=5)
    field = reduce(problem)
    line = np.column_stack([np.linspace(0.1, 0.9, 4001), np.full(4001, 0.03)])
    error = field(line).displacement - problem.standard(line)
    assert np.abs(np.diff(error, axis=0)).max() < 2e-5 * problem.largest


def test_the_spacing_is_the_one_with_the_fewest_sums() -> None:
    problem = problem_of(2)
    nodes = np.random.default_rng(3).uniform(-1.0, 1.0, (20_000, 2))
    problem = replace(problem, nodes=nodes)
    chosen = reduce(problem)
    assert isinstance(chosen, GridField)
    places = chosen(problem.nodes).places
    assert places < 0.5 * len(problem.nodes)
    for factor in (0.5, 2.0):
        other = reduce(replace(problem, length=factor * chosen.grid.spacing))
        assert places <= 1.1 * other(problem.nodes).places
