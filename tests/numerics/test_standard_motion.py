"""The standard motion: exact where it must be, and dependent only on its declared inputs."""

import numpy as np
import pytest
from frame_meshes import rotation, square_frame
from mesh_motion_numerics.interpolation.factor_source import MakeEachTime
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.standard_motion import StandardMotion, StandardTrial
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from mesh_motion_numerics.stopwatch import Stopwatch
from trial_stages import displacement_by

from mesh_motion_server.session.factors import FactorCache


def motion_of(mesh, **choices) -> StandardMotion:
    points, cells, patches = mesh
    method = Method(**{"support_radius": 0.5, **choices})
    return StandardMotion.build(points, boundary_facets(cells), patches, method)


def move(motion: StandardMotion, committed: np.ndarray, targets: np.ndarray) -> StandardTrial:
    return motion.trial(committed, targets, MakeEachTime(), Stopwatch())


def carried(points: np.ndarray, degrees: float, shift: tuple[float, float], centre=(0.5, 0.5)) -> np.ndarray:
    return (points - centre) @ rotation(degrees).T + centre + shift


@pytest.mark.parametrize("displacement", ["relative", "absolute", "reanchored"])
@pytest.mark.parametrize("degrees", [0.0, 37.0, 180.0])
def test_a_mesh_carried_as_a_whole_is_reproduced(displacement: str, degrees: float) -> None:
    mesh = square_frame(outer="moving")
    motion = motion_of(mesh, displacement=displacement)
    targets = carried(mesh[0][motion.roles.moving], degrees, (0.3, -0.2))
    trial = move(motion, mesh[0], targets)
    np.testing.assert_allclose(trial.points, carried(mesh[0], degrees, (0.3, -0.2)), atol=2e-14)


@pytest.mark.parametrize("displacement", ["absolute", "reanchored"])
def test_no_drift_from_the_reference(displacement: str) -> None:
    """The boundary alone decides, for any earlier commits."""
    mesh = square_frame()
    motion = motion_of(mesh, displacement=displacement)
    rest = mesh[0][motion.roles.moving]
    away = move(motion, mesh[0], carried(rest, 25.0, (0.1, 0.0)))
    back = move(motion, away.points, rest)
    assert np.array_equal(back.points, mesh[0])


def test_relative_displacement_drifts_on_a_cycle() -> None:
    """The thesis' Fig. 2.3: the motion starts each step from the last mesh, and does not return."""
    mesh = square_frame()
    motion = motion_of(mesh, displacement="relative")
    rest = mesh[0][motion.roles.moving]
    points = mesh[0]
    for degrees in (15.0, 30.0, 15.0, 0.0):
        points = move(motion, points, carried(rest, degrees, (0.0, 0.0))).points
    assert np.array_equal(points[motion.roles.moving], carried(rest, 0.0, (0.0, 0.0)))
    assert 1e-5 < np.abs(points - mesh[0]).max() < 0.05


def test_reanchoring_takes_a_rotation_that_one_step_cannot() -> None:
    mesh = square_frame()
    sizes = reference_sizes(mesh[0], mesh[1])
    worst = {}
    for displacement in ("absolute", "reanchored"):
        motion = motion_of(mesh, displacement=displacement, support_radius=2.5)
        targets = carried(mesh[0][motion.roles.moving], 100.0, (0.0, 0.0))
        trial = move(motion, mesh[0], targets)
        worst[displacement] = cell_quality(trial.points, mesh[1], sizes).metric("size-skew").min()
    assert worst["absolute"] < 0 < worst["reanchored"]


@pytest.mark.parametrize("role", ["slip", "symmetry"])
def test_sliding_nodes_stay_on_their_sides_and_move_along_them(role: str) -> None:
    mesh = square_frame(outer=role)
    motion = motion_of(mesh, support_radius=2.5)
    trial = move(motion, mesh[0], carried(mesh[0][motion.roles.moving], 0.0, (0.1, 0.0)))
    outer = mesh[2]["outer"].nodes
    before, after = mesh[0][outer], trial.points[outer]
    for axis in (0, 1):
        for side in (0.0, 1.0):
            on_side = before[:, axis] == side
            assert np.array_equal(after[on_side, axis], before[on_side, axis])
    corners = np.all((before == 0.0) | (before == 1.0), axis=1)
    assert np.array_equal(after[corners], before[corners])
    assert np.abs(after - before).max() > 0.01


def test_the_field_is_the_motion_of_the_nodes() -> None:
    mesh = square_frame()
    motion = motion_of(mesh, displacement="reanchored")
    trial = move(motion, mesh[0], carried(mesh[0][motion.roles.moving], 70.0, (0.05, 0.0)))
    assert len(trial.stages) > 1
    np.testing.assert_allclose(mesh[0] + displacement_by(trial, mesh[0]), trial.points, atol=1e-11)


def test_the_answer_does_not_depend_on_the_cache() -> None:
    mesh = square_frame()
    motion = motion_of(mesh)
    targets = carried(mesh[0][motion.roles.moving], 20.0, (0.1, 0.05))

    factors = FactorCache(1 << 24)
    narrow = motion_of(mesh, support_radius=0.4)
    for moved, made in ((motion, 1), (motion, 1), (narrow, 2)):
        trial = moved.trial(mesh[0], targets, factors, Stopwatch())
        assert factors.made["factorization"] == made
        assert np.array_equal(trial.points, move(moved, mesh[0], targets).points)
