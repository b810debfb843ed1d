"""The full greedy algorithm."""

import numpy as np

from mesh_motion_server.numerics.interpolant import factorize
from mesh_motion_server.numerics.reduction import REDUCTIONS, ReductionProblem


def ellipse(n: int = 60) -> np.ndarray:
    angle = 2 * np.pi * np.arange(n) / n
    return np.column_stack([np.cos(angle), 0.4 * np.sin(angle)])


def test_with_every_node_it_is_the_full_interpolation() -> None:
    points = ellipse()
    displacement = np.column_stack([0.1 * points[:, 1] ** 2, 0.2 * points[:, 0] ** 3])
    reduced = REDUCTIONS["greedy"](ReductionProblem(points, displacement, support_radius=2.0, tolerance=0.0))
    assert sorted(reduced.selected) == list(range(len(points)))
    full = factorize(points, support_radius=2.0).solve(displacement)
    np.testing.assert_allclose(
        reduced.levels[0].weights, full.weights[reduced.selected], atol=1e-9 * np.abs(full.weights).max()
    )


def test_the_tolerance_is_met_with_few_nodes() -> None:
    points = ellipse(200)
    displacement = np.column_stack([0.1 * points[:, 1] ** 2, 0.2 * points[:, 0] ** 3])
    reduced = REDUCTIONS["greedy"](ReductionProblem(points, displacement, support_radius=2.0, tolerance=1e-2))
    assert len(reduced.selected) < 50
    assert reduced.max_error <= 1e-2 * np.linalg.norm(displacement, axis=1).max()
    assert [iterate.points for iterate in reduced.history] == list(range(1, len(reduced.selected) + 1))
