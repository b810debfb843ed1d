from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_motion_numerics.mesh.paths import fit_rigid_motion, split_rigid, substeps
from scipy.spatial.transform import Rotation


def turn(d, degrees, axis=(0.0, 0.0, 1.0)):
    if d == 1:
        return np.eye(1)
    vector = np.radians(degrees) * np.asarray(axis) / np.linalg.norm(axis)
    return Rotation.from_rotvec(vector).as_matrix()[:d, :d]


def distances(points):
    return np.linalg.norm(points[:, None] - points, axis=2)


angles = st.one_of(st.sampled_from([0.0, 1e-8, 1e-4, 90.0, 179.0, 179.999999, 180.0]), st.floats(0.0, 180.0))


@given(
    d=st.sampled_from([1, 2, 3]),
    degrees=angles,
    axis=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.1, 1)),
    shift=st.floats(-10, 10),
)
def test_a_rigid_motion_is_found_and_every_substep_is_rigid(d, degrees, axis, shift):
    points = np.random.default_rng(0).random((25, d)) + 2.0
    rotation = turn(d, degrees, axis if d == 3 else (0, 0, 1))
    moved = points @ rotation.T + shift * np.arange(1, d + 1)
    rigid = fit_rigid_motion(points, moved)
    assert np.allclose(rigid.rotation, rotation, rtol=0, atol=1e-12)
    assert np.allclose(rigid.apply(points), moved, rtol=0, atol=1e-13 * (20 + abs(shift)))
    path = substeps(points, moved - points, 5)
    assert path[-1].tobytes() == (moved - points).tobytes()
    for displacement in path:
        assert np.allclose(distances(points + displacement), distances(points), rtol=0, atol=1e-12 * (1 + abs(shift)))


def test_steps_are_equal_turns():
    points = np.random.default_rng(0).random((9, 2))
    rotation = turn(2, 120.0)
    path = substeps(points, points @ rotation.T - points, 4)
    places = [points, *(points + displacement for displacement in path)]
    for before, after in pairwise(places):
        assert np.isclose(fit_rigid_motion(before, after).angle, np.radians(30), rtol=1e-12)


def test_a_hinge_stays_where_it_is():
    flap = np.column_stack([np.linspace(0, 1, 11), np.zeros(11)])
    path = substeps(flap, flap @ turn(2, 90.0).T - flap, 6)
    assert np.max(np.abs(path[:, 0])) < 1e-15


def test_a_screw_advances_along_its_axis():
    points = np.random.default_rng(0).random((12, 3))
    moved = points @ turn(3, 100.0).T + [0.0, 0.0, 2.0]
    path = substeps(points, moved - points, 4)
    assert np.allclose(path[:, :, 2], np.array([0.5, 1.0, 1.5, 2.0])[:, None], rtol=0, atol=1e-14)


def test_without_rotation_the_path_is_the_scaled_displacement():
    points = np.random.default_rng(0).random((30, 3))
    bend = np.column_stack([np.zeros(30), np.zeros(30), 0.3 * (points[:, 0] - 0.5) ** 2])
    bend -= bend.mean(axis=0)
    path = substeps(points, np.tile([1.0, 2.0, 3.0], (30, 1)), 4)
    assert np.allclose(path, np.arange(1, 5)[:, None, None] / 4 * [1.0, 2.0, 3.0], rtol=0, atol=1e-14)
    assert np.allclose(substeps(points, 1.1 * points - points, 2)[0], 0.05 * points, rtol=0, atol=1e-15)


def test_bending_grows_in_the_frame_of_the_turning_body():
    line = np.column_stack([np.linspace(-1, 1, 21), np.zeros(21)])
    bent = line + np.column_stack([np.zeros(21), 0.1 * (line[:, 0] ** 2 - np.mean(line[:, 0] ** 2))])
    path = substeps(line, bent @ turn(2, 90.0).T - line, 2)
    half = line + np.column_stack([np.zeros(21), 0.05 * (line[:, 0] ** 2 - np.mean(line[:, 0] ** 2))])
    assert np.allclose(line + path[0], half @ turn(2, 45.0).T, rtol=0, atol=1e-14)


@pytest.mark.parametrize("d", [2, 3])
def test_exactly_half_a_turn_has_one_sense(d):
    """Noise of rounding size must not choose the direction in which a body turns."""
    points = np.random.default_rng(0).standard_normal((20, d))
    flip = np.array([-1.0, -1.0, 1.0])[:d]
    paths = []
    for seed in range(5):
        noise = 1e-15 * np.random.default_rng(seed).standard_normal(points.shape)
        paths.append(substeps(points, points * flip + noise - points, 2)[0])
    assert all(np.allclose(path, paths[0], rtol=0, atol=1e-12) for path in paths)
    quarter = points @ turn(d, 90.0).T
    assert np.allclose(points + paths[0], quarter + (paths[0] + points - quarter).mean(axis=0), rtol=0, atol=1e-12)


class TestDegenerate:
    def test_one_point_translates(self):
        rigid = fit_rigid_motion(np.ones((1, 3)), np.full((1, 3), 3.0))
        assert rigid.angle == 0
        assert np.allclose(rigid.translation, 2.0)

    def test_all_points_in_one_place(self):
        assert fit_rigid_motion(np.ones((4, 2)), np.zeros((4, 2))).angle == 0

    @pytest.mark.parametrize("target", [(0.0, 1.0, 0.0), (0.6, 0.0, 0.8), (1.0, 0.0, 0.0)])
    def test_a_line_takes_the_smallest_rotation(self, target):
        line = np.linspace(-1, 1, 7)[:, None] * [1.0, 0.0, 0.0]
        moved = np.linspace(-1, 1, 7)[:, None] * np.array(target)
        rigid = fit_rigid_motion(line, moved)
        assert np.allclose(rigid.apply(line), moved, rtol=0, atol=1e-15)
        assert np.isclose(rigid.angle, np.arccos(target[0]), atol=1e-12)

    @pytest.mark.parametrize("direction", [*np.eye(3).tolist(), [0.6, 0.0, 0.8], [1.0, 1.0, 1.0]])
    def test_a_reversed_line_turns_by_half(self, direction):
        line = np.linspace(-1, 1, 7)[:, None] * np.array(direction)
        rigid = fit_rigid_motion(line, -line)
        assert rigid.angle == np.pi
        assert np.allclose(rigid.apply(line), -line, rtol=0, atol=1e-15)
        assert np.max(rigid.axis) == np.max(np.abs(rigid.axis))

    def test_a_mirror_image_gets_a_proper_rotation(self):
        points = np.random.default_rng(0).random((10, 3))
        assert np.isclose(np.linalg.det(fit_rigid_motion(points, points * [-1, 1, 1]).rotation), 1.0)

    def test_points_in_a_plane(self):
        points = np.random.default_rng(0).random((10, 3)) * [1, 1, 0]
        moved = points @ turn(3, 70.0, (1.0, 2.0, 3.0)).T
        assert np.allclose(fit_rigid_motion(points, moved).apply(points), moved, rtol=0, atol=1e-14)


def test_split_gives_what_is_not_rigid():
    points = np.random.default_rng(0).random((15, 2))
    wobble = 0.01 * np.random.default_rng(1).standard_normal((15, 2))
    rigid, remainder = split_rigid(points, points @ turn(2, 33.0).T + wobble - points)
    assert np.linalg.norm(remainder) <= np.linalg.norm(wobble)
    assert np.allclose(rigid.apply(points) + remainder, points @ turn(2, 33.0).T + wobble, rtol=0, atol=1e-15)


def test_apply_works_row_by_row():
    points = np.random.default_rng(0).random((40, 3))
    rigid = fit_rigid_motion(points, points @ turn(3, 50.0, (1, 1, 0)).T)
    whole = rigid.apply(points, 0.3)
    assert all(np.array_equal(rigid.apply(points[i : i + 1], 0.3)[0], whole[i]) for i in range(40))
