"""Interpolation in two scales: exact at every boundary node, close to the interpolation in one scale, repeatable to the
bit.
"""

from itertools import pairwise

import numpy as np
import pytest
from frame_meshes import tensor_grid
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.interpolation.two_scale import compact_levels as levels_module
from mesh_motion_numerics.interpolation.two_scale.coarse_points import coarse_points
from mesh_motion_numerics.interpolation.two_scale.compact_levels import CompactSystem, compact_levels
from mesh_motion_numerics.interpolation.two_scale.factorization import (
    AUTOMATIC_FROM,
    TwoScaleFactorization,
    TwoScalePlan,
    plans_for,
)
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.neighbours import local_spacing
from mesh_motion_numerics.mesh.roles import BoundaryRoles, Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from two_scale_boundaries import boundary, graded_circle, graded_sphere, sphere, walls

Floats = NDArray[np.float64]

CASES = {
    "3D": boundary(sphere(1500, 0.15), walls(12)),
    "2D, spacing × 30": boundary(graded_circle(900, 30.0), walls(40, 2)),
    "3D, spacing × 30": boundary(graded_sphere(4000, 30.0), walls(12)),
    "3D, domain of 50 bodies": boundary(sphere(1200, 0.01), walls(10)),
    "2D, domain of 50 bodies": boundary(0.5 + 0.1 * (graded_circle(900, 1.0) - 0.5), walls(40, 2)),
}


def _plan(points: Floats, moving: NDArray[np.bool_], count: int = 250) -> TwoScalePlan:
    return TwoScalePlan.build(points, moving, basis="wendland-c2", support_radius=2.5, count=count)


def _prepared(points: Floats, moving: NDArray[np.bool_], **choices: int) -> TwoScaleFactorization:
    return _plan(points, moving, **choices).factorize(points, points.min(axis=0), points.max(axis=0))


def _turn(points: Floats, moving: NDArray[np.bool_]) -> Floats:
    """The body turned by 30° and bent; the rest in place."""
    centre = points[moving].mean(axis=0)
    size = float(np.ptp(points[moving], axis=0).max())
    x = (points - centre) / size
    turned = x.copy()
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    turned[:, 0], turned[:, 1] = c * x[:, 0] - s * x[:, 1], s * x[:, 0] + c * x[:, 1] + 0.2 * x[:, 0] ** 2
    return np.where(moving[:, None], size * (turned - x), 0.0)


@pytest.mark.parametrize("name", CASES)
def test_every_boundary_node_is_met_however_rough_the_displacement(name: str) -> None:
    points, moving = CASES[name]
    prepared = _prepared(points, moving)
    rough = np.random.default_rng(1).normal(size=points.shape)
    for values in (_turn(points, moving), rough):
        found = evaluation.displacement(prepared.solve(values), points)
        assert np.abs(found - values).max() <= 1e-10 * np.abs(values).max()


@pytest.mark.parametrize("name", CASES)
def test_the_field_is_near_the_one_of_all_centres(name: str) -> None:
    """At places away from the body by at least its boundary's spacing; the body's motion extends there."""
    points, moving = CASES[name]
    values = _turn(points, moving)
    d, centre = points.shape[1], points[moving].mean(axis=0)
    size = float(np.ptp(points[moving], axis=0).max())
    rng = np.random.default_rng(2)
    direction = rng.normal(size=(400, d))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    places = centre + size * direction * rng.uniform(0.55, 1.5, (400, 1))
    distance, nearest = cKDTree(points).query(places)
    places = places[distance >= local_spacing(points)[nearest]]
    assert len(places) > 200
    count, tolerance = (500, 0.06) if name == "3D, spacing × 30" else (250, 0.03)  # few of its points lie widely
    exact = factorize(points, basis="wendland-c2", support_radius=2.5).solve(values)
    found = evaluation.displacement(_prepared(points, moving, count=count).solve(values), places)
    difference = np.abs(found - evaluation.displacement(exact, places)).max()
    assert difference <= tolerance * np.abs(values).max()


def test_more_coarse_points_come_nearer() -> None:
    points, moving = CASES["3D"]
    values = _turn(points, moving)
    places = 0.5 + 0.2 * (sphere(300, 1.0, 0.0))
    exact = evaluation.displacement(factorize(points, basis="wendland-c2", support_radius=2.5).solve(values), places)
    errors = [
        np.abs(evaluation.displacement(_prepared(points, moving, count=n).solve(values), places) - exact).max()
        for n in (60, 240, 960)
    ]
    assert errors[0] > 2.0 * errors[1] > 4.0 * errors[2]


def test_the_gradient_is_that_of_the_values() -> None:
    points, moving = CASES["3D"]
    found = _prepared(points, moving).solve(_turn(points, moving))
    places, h = 0.5 + 0.18 * sphere(200, 1.0, 0.0), 1e-6
    gradient = evaluation.gradient(found, places)
    for m in range(3):
        step = h * np.eye(3)[m]
        ahead, behind = evaluation.displacement(found, places + step), evaluation.displacement(found, places - step)
        np.testing.assert_allclose(gradient[:, :, m], (ahead - behind) / (2 * h), atol=1e-7)


def test_a_displaced_mesh_is_solved_with_the_reference_mesh_preconditioner(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CompactSystem, "_preconditioners", lambda system: [system.level.precondition])
    monkeypatch.setattr(levels_module, "_MAX_ITERATIONS", 40)
    points, moving = CASES["3D"]
    plan = _plan(points, moving)
    displaced = points + _turn(points, moving)
    prepared = plan.factorize(displaced, points.min(axis=0), points.max(axis=0))
    values = _turn(points, moving)
    found = prepared.solve(values)
    assert np.abs(evaluation.displacement(found, displaced) - values).max() <= 1e-10 * np.abs(values).max()


def test_the_same_question_has_the_same_answer_to_the_bit() -> None:
    points, moving = CASES["2D, spacing × 30"]
    places = np.random.default_rng(5).random((500, 2))
    values = _turn(points, moving)
    first = evaluation.displacement(_prepared(points, moving).solve(values), places)
    other = _prepared(points, moving).solve(values)
    parts = [evaluation.displacement(other, part) for part in np.array_split(places, 7)]
    np.testing.assert_array_equal(first, np.concatenate(parts))


def test_levels_follow_the_spacing() -> None:
    even = sphere(1500, 0.15)
    all_of = np.arange(len(even))
    assert len(compact_levels(even, local_spacing(even), np.full(len(even), True), coarse=all_of, gap=0.0)) == 1
    points, moving = CASES["2D, spacing × 30"]
    points = np.hstack([points, np.zeros((len(points), 1))])
    spacing = local_spacing(points)
    coarse = coarse_points(points, spacing, moving, 200)
    levels = compact_levels(points, spacing, moving, coarse=coarse, gap=0.0)
    assert len(levels) > 2
    assert len(levels[-1].members) == len(points)
    radii = [level.radius for level in levels]
    assert radii == sorted(radii, reverse=True)
    assert radii[0] > 0.5 * np.percentile(spacing[moving], 95)
    for wide, narrow in pairwise(levels):
        alone = np.flatnonzero(moving & (spacing > narrow.radius))  # the next radius does not join them to any other
        assert np.isin(alone, wide.members).all()


def test_coarse_points_are_shared_between_the_body_and_the_rest() -> None:
    points, moving = CASES["3D, domain of 50 bodies"]
    spacing = local_spacing(points)
    chosen = coarse_points(points, spacing, moving, 200)
    assert len(np.unique(chosen)) == 200
    assert np.count_nonzero(moving[chosen]) == 120
    # well spread: each body point has a chosen point within a few of its own spacings
    gap = np.linalg.norm(points[moving][:, None] - points[chosen[moving[chosen]]], axis=2).min(axis=1)
    assert gap.max() < 5.0 * spacing[moving].max()
    assert len(coarse_points(points, spacing, moving, 10**6)) == len(points)
    few = np.arange(len(points)) < 10
    assert np.count_nonzero(few[coarse_points(points, spacing, few, 200)]) == 10


def _bar(rows: int) -> tuple[Floats, CellTable, dict[str, Patch]]:
    points, quads = tensor_grid(*[np.linspace(0.0, 1.0, rows + 1)] * 2)
    left, right = np.flatnonzero(points[:, 0] == 0.0), np.flatnonzero(points[:, 0] == 1.0)
    below = np.flatnonzero(points[:, 1] == 0.0)
    patches = {"left": Patch("moving", left), "right": Patch("fixed", right), "below": Patch("slip", below)}
    return points, CellTable.from_arrays({"quad": quads}), patches


@pytest.mark.parametrize("displacement", ["relative", "absolute", "reanchored"])
def test_a_session_moves_in_two_scales(displacement: str, monkeypatch: pytest.MonkeyPatch) -> None:
    points, cells, patches = _bar(24)
    targets = points[patches["left"].nodes] + np.array([0.1, 0.0])
    moved = {}
    for scales, most in (("one", AUTOMATIC_FROM), ("two", 0)):
        monkeypatch.setattr("mesh_motion_numerics.interpolation.two_scale.factorization.AUTOMATIC_FROM", most)
        model = MotionModel.build(points, cells, patches, Method(support_radius=2.0, displacement=displacement))
        motion = model.move(points, targets)
        moved[scales] = motion.points
        np.testing.assert_array_equal(motion.points[patches["left"].nodes], targets)
        np.testing.assert_allclose(motion.points[patches["below"].nodes, 1], 0.0, atol=1e-14)
    assert np.abs(moved["one"] - moved["two"]).max() < 2e-4


def test_a_radius_that_does_not_join_the_coarse_points_is_left_to_one_scale() -> None:
    points, moving = CASES["3D"]
    roles = BoundaryRoles(np.flatnonzero(moving), np.flatnonzero(~moving), *(np.empty(0, dtype=np.int64),) * 2)
    many = np.vstack([points, np.random.default_rng(6).random((AUTOMATIC_FROM, 3))])
    roles = BoundaryRoles(roles.moving, np.arange(len(roles.moving), len(many)), roles.sliding, roles.periodic)
    for method, planned in (
        (Method(support_radius=2.5), 1),
        (Method(support_radius=0.05), 0),
        (Method(support_radius=2.5, reduction="greedy"), 0),
        (Method(basis="tps"), 0),
    ):
        plans = plans_for(many, [roles.all], roles, method)
        assert list(plans) == [roles.all.tobytes()] * planned
