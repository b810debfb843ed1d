"""The part of a field for a box gives the same values there, bit for bit, and is as small as possible."""

import numpy as np
import pytest
from mesh_motion_numerics.distributed.field import Field
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.evaluation import NearOperator, displacement, gradient
from mesh_motion_numerics.interpolation.interpolant import Interpolant, factorize
from mesh_motion_numerics.interpolation.kernels import BASES
from mesh_motion_numerics.interpolation.two_scale.factorization import TwoScalePlan
from mesh_motion_numerics.interpolation.two_scale.interpolant import AnyInterpolant, TwoScaleInterpolant
from two_scale_boundaries import boundary, graded_circle, sphere, walls

RANDOM = np.random.default_rng(11)
BOXES = {2: [(0.0, 0.3), (0.35, 0.65), (0.6, 1.0), (0.9, 0.99)], 3: [(0.0, 0.3), (0.3, 0.7), (0.6, 1.0)]}


def one_scale(basis: str, radius: float | None, d: int) -> AnyInterpolant:
    points = RANDOM.random((60, d))
    return factorize(points, basis=basis, support_radius=radius).solve(RANDOM.random((60, d)) - 0.5)


def two_scales(d: int) -> AnyInterpolant:
    body, rest = (graded_circle(300, 20.0), walls(30, 2)) if d == 2 else (sphere(300, 0.1), walls(6))
    points, moving = boundary(body, rest)
    plan = TwoScalePlan.build(points, moving, basis="wendland-c2", support_radius=2.5, count=60)
    found = plan.factorize(points, np.zeros(d), np.ones(d)).solve(np.where(moving[:, None], 0.1 * points**2, 0.0))
    assert len(found.levels) > 1 or d == 3
    return found


def travelled(interpolant: AnyInterpolant, box: np.ndarray) -> AnyInterpolant:
    """The interpolant rebuilt from the transferred data."""
    field = Field.of(interpolant)
    return field.part(box).of(field.coefficients).interpolant()


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
    for low, high in BOXES[d]:
        box = np.array([[low] * d, [high] * d])
        points = np.vstack([low + (high - low) * RANDOM.random((400, d)), box])
        again = travelled(interpolant, box)
        np.testing.assert_array_equal(displacement(again, points), displacement(interpolant, points))
        if isinstance(interpolant, TwoScaleInterpolant) or interpolant.basis.gradient_at_centre:
            np.testing.assert_array_equal(gradient(again, points), gradient(interpolant, points))


@pytest.mark.parametrize("radius", [0.004, 0.3], ids=["stored cells", "all cells"])
def test_a_compact_level_of_a_small_body_is_bitwise_the_same(radius: float) -> None:
    centres = np.vstack([0.5 + 0.01 * RANDOM.normal(size=(400, 3)), RANDOM.random((50, 3)), np.zeros((1, 3))])
    basis = BASES["wendland-c2"]
    layout = CentreLayout.build(centres, basis, radius)
    level = Interpolant(centres, RANDOM.random((len(centres), 3)), basis, radius, layout, None)
    for low, high in ((0.49, 0.503), (0.4, 0.5), (0.8, 0.9)):
        points = low + (high - low) * RANDOM.random((2000, 3))
        box = np.array([[low] * 3, [high] * 3])
        part = travelled(level, box)
        found = [np.zeros_like(points) for _ in range(2)]
        for each, out in zip((level, part), found, strict=True):
            NearOperator.build(each, points).add(each.weights, out)
        np.testing.assert_array_equal(*found)


def test_points_beyond_the_domain_take_the_rims_value() -> None:
    found = two_scales(3)
    box = np.array([[0.9, 0.4, 0.4], [1.2, 0.6, 0.6]])
    points = box[0] + (box[1] - box[0]) * RANDOM.random((200, 3))
    again = travelled(found, box)
    np.testing.assert_array_equal(displacement(again, points), displacement(found, points))


def test_a_box_takes_its_share() -> None:
    field = Field.of(two_scales(3))
    boxes = [np.array([[low] * 3, [high] * 3]) for low, high in ((0, 1), (0.4, 0.6), (0.8, 0.9))]
    whole, part, far = (len(field.part(box).rows) for box in boxes)
    assert whole == len(field.coefficients)
    assert part < 0.5 * whole
    assert far < 0.1 * whole
