"""What travels of an interpolant gives the same values, bit for bit, and is as small as it can be."""

from __future__ import annotations

import numpy as np
import pytest
from two_scale_boundaries import boundary, graded_circle, sphere, square, walls

from mesh_motion_server.distributed.packing import pack, unpack
from mesh_motion_server.numerics.interpolation.evaluation import LocalEvaluator
from mesh_motion_server.numerics.interpolation.interpolant import factorize
from mesh_motion_server.numerics.interpolation.two_scale.factorization import TwoScalePlan
from mesh_motion_server.numerics.interpolation.two_scale.interpolant import AnyInterpolant

RANDOM = np.random.default_rng(11)
BOXES = {2: [(0.0, 0.3), (0.35, 0.65), (0.6, 1.0), (0.9, 0.99)], 3: [(0.0, 0.3), (0.3, 0.7), (0.6, 1.0)]}


def one_scale(basis: str, radius: float | None, d: int) -> AnyInterpolant:
    points = RANDOM.random((60, d))
    return factorize(points, basis=basis, support_radius=radius).solve(RANDOM.random((60, d)) - 0.5)


def two_scales(d: int) -> AnyInterpolant:
    body, rest = (graded_circle(300, 20.0), square(30)) if d == 2 else (sphere(300, 0.1), walls(6))
    points, moving = boundary(body, rest)
    plan = TwoScalePlan.build(points, moving, basis="wendland-c2", support_radius=2.5, count=60)
    found = plan.factorize(points, np.zeros(d), np.ones(d)).solve(np.where(moving[:, None], 0.1 * points**2, 0.0))
    assert len(found.levels) > 1 or d == 3
    return found


@pytest.mark.parametrize(
    ("interpolant", "d"),
    [
        (one_scale("wendland-c2", 0.15, 2), 2),
        (one_scale("wendland-c2", 0.2, 3), 3),
        (one_scale("wendland-c2", 2.0, 3), 3),
        (one_scale("tps", None, 2), 2),
        (two_scales(2), 2),
        (two_scales(3), 3),
    ],
    ids=["by cells 2D", "by cells 3D", "all centres", "polynomial", "two scales 2D", "two scales 3D"],
)
def test_values_and_gradients_in_the_box_are_bitwise_the_same(interpolant: AnyInterpolant, d: int) -> None:
    evaluator = LocalEvaluator()
    for low, high in BOXES[d]:
        box = np.array([[low] * d, [high] * d])
        points = np.vstack([low + (high - low) * RANDOM.random((400, d)), box])
        (travelled,) = unpack(pack((interpolant,), box))
        np.testing.assert_array_equal(
            evaluator.displacement(travelled, points), evaluator.displacement(interpolant, points)
        )
        if interpolant.basis.gradient_at_centre:
            np.testing.assert_array_equal(
                evaluator.gradient(travelled, points), evaluator.gradient(interpolant, points)
            )


def test_points_beyond_the_domain_take_the_rims_value() -> None:
    found = two_scales(3)
    box = np.array([[0.9, 0.4, 0.4], [1.2, 0.6, 0.6]])
    points = box[0] + (box[1] - box[0]) * RANDOM.random((200, 3))
    (travelled,) = unpack(pack((found,), box))
    evaluator = LocalEvaluator()
    np.testing.assert_array_equal(evaluator.displacement(travelled, points), evaluator.displacement(found, points))


def test_a_box_takes_its_share() -> None:
    found = two_scales(3)
    whole, part, far = (len(pack((found,), np.array([[a] * 3, [b] * 3]))) for a, b in ((0, 1), (0.4, 0.6), (0.8, 0.9)))
    assert part < 0.5 * whole
    assert far < 0.1 * whole
