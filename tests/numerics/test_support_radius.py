"""The suggested support radius is global where the arithmetic allows it, and usable where it does not."""

import numpy as np
import pytest

from mesh_motion_server.numerics.evaluation import LocalEvaluator
from mesh_motion_server.numerics.interpolant import factorize
from mesh_motion_server.numerics.roles import BoundaryRoles
from mesh_motion_server.numerics.support_radius import suggest_support_radius

NONE = np.empty(0, dtype=np.int64)


def roles(n: int) -> BoundaryRoles:
    return BoundaryRoles(np.arange(n), NONE, NONE, NONE)


def circle(n: int, radius: float) -> np.ndarray:
    angle = 2 * np.pi * np.arange(n) / n
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def test_two_and_a_half_domains():
    points = np.vstack([circle(40, 1.0), [[-4.0, 0.0], [6.0, 1.0]]])
    assert suggest_support_radius(points, roles(40)) == 25.0
    assert suggest_support_radius(1e-3 * points, roles(40)) == 0.025


def test_a_lone_moving_node_and_a_close_pair_do_not_matter():
    line = np.linspace(0, 1, 11)[:, None]
    assert suggest_support_radius(line, roles(1)) == 2.5
    points = np.vstack([circle(100, 1.0), [[1.0, 1e-9]]])
    assert suggest_support_radius(points, roles(101)) == 5.0


def test_a_far_field_hundreds_of_bodies_away_leaves_a_matrix_that_can_be_solved():
    points = np.vstack([circle(1000, 0.5) * [1.0, 0.05], circle(100, 500.0)])
    radius = suggest_support_radius(points, roles(len(points)))
    assert 2.0 < radius < 20.0
    displacement = np.where((np.arange(1100) < 1000)[:, None], [0.1, -0.2] + 0.1 * points[:, ::-1], 0.0)
    interpolant = factorize(points, support_radius=radius).solve(displacement)
    found = LocalEvaluator().displacement(interpolant, points)
    assert found == pytest.approx(displacement, abs=1e-9)
