"""The suggested radii follow the geometry: the domain, the moving bodies and the gaps, not the spacing."""

import numpy as np
import pytest
from mesh_motion_numerics.interpolation.support_radius import (
    suggest_enrichment_radius,
    suggest_support_radius,
    with_reach,
)
from mesh_motion_numerics.mesh.roles import BoundaryRoles
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from sliding_meshes import duct

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


def test_a_far_field_hundreds_of_bodies_away_and_the_spacing_do_not_enlarge_or_reduce_it():
    for count, far in ((100, 50.0), (100, 500.0), (3000, 500.0)):
        points = np.vstack([circle(count, 0.5) * [1.0, 0.05], circle(100, far)])
        body = BoundaryRoles(np.arange(count), np.arange(count, count + 100), NONE, NONE)
        assert suggest_support_radius(points, body) == 50.0


def test_the_enrichment_radius_is_the_diameter_of_the_largest_ball_between_the_boundaries():
    axis = np.linspace(0.0, 1.0, 41)
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    boundary = np.flatnonzero((np.abs(points - 0.5).max(axis=1) > 0.499) | (np.abs(points - 0.5).max(axis=1) < 0.1))
    held = BoundaryRoles(boundary, NONE, NONE, NONE)
    expected = 2 * np.linalg.norm(points[:, None] - points[boundary], axis=2).min(axis=1).max()
    assert suggest_enrichment_radius(points, held, 2.5) == pytest.approx(expected, rel=0.05)
    assert suggest_enrichment_radius(1e-3 * points, held, 2.5) == pytest.approx(1e-3 * expected, rel=0.05)


def test_the_enrichment_radius_is_no_larger_than_the_support_radius_and_never_zero():
    line = np.linspace(0, 1, 11)[:, None]
    ends = BoundaryRoles(np.array([0, 10]), NONE, NONE, NONE)
    assert suggest_enrichment_radius(line, ends, 2.5) == 1.0
    assert suggest_enrichment_radius(line, ends, 0.3) == 0.3
    assert suggest_enrichment_radius(line, roles(11), 2.5) == 2.5


@pytest.mark.parametrize(("count", "wave"), [(400, 1 / 8), (24, 3 * np.sin(np.pi / 24)), (4, 0.5)])
def test_the_first_level_follows_no_waves_that_a_coarse_wall_does_not_have(count: int, wave: float) -> None:
    points = np.vstack([circle(count, 0.5), circle(100, 5.0)])
    body = BoundaryRoles(np.arange(count), np.arange(count, count + 100), NONE, NONE)
    smoothing = with_reach(Method(), points, body, periodic=None)[1].smoothing
    assert smoothing is not None
    assert smoothing.wave == pytest.approx(wave, rel=1e-9)


@pytest.mark.parametrize(
    "choices",
    [
        {},
        {"correction": "none"},
        {"correction": "optimised"},
        {"correction": "explicit", "quality_threshold": 0.9, "allow_invalid": True},
        {"displacement": "reanchored"},
    ],
    ids=str,
)
@pytest.mark.parametrize("far", [3.0, 1e3, 1e9])
def test_a_node_in_no_cell_and_no_patch_changes_nothing_elsewhere(choices: dict[str, object], far: float) -> None:
    """Such as the centre of an arc, or a reference node: in the box of the mesh it would change all radii."""
    points, cells, patches = duct("quad", 10)
    found = []
    for mesh in (points, np.vstack([points, [far, -far]])):
        model = MotionModel.build(mesh, cells, patches, Method(**choices))
        moved = model.move(mesh, mesh[model.roles.moving] + [0.12, 0.2])
        found.append(moved.points[: len(points)])
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-11)
