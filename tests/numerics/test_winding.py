"""Bodies that turn by more than half a turn: 200 degrees is not −160, in any number of steps and after a restart."""

from functools import cache

import numpy as np
import pytest
from box_meshes import box_mesh
from correction_cases import BodyMesh, ring, stored
from frame_meshes import ring_grid
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.motion.motion_found import Motion
from mesh_motion_numerics.motion.winding import UNWOUND, Turns, wound
from scipy.spatial.transform import Rotation

from mesh_motion_server.session.factors import FactorCache

TOLERANCE = 1e-9


@cache
def model(kind: str) -> MotionModel:
    made = {"triangle": lambda: stored("thesis_block"), "ring": ring, "layered": layered}
    mesh = made.get(kind, lambda: box_mesh(kind))()
    return MotionModel.build(mesh.points, mesh.cells, mesh.patches, Method())


def layered() -> BodyMesh:
    spacing = 2e-3 * 1.35 ** np.arange(25)
    points, quads = ring_grid(1.0 + np.cumsum(np.append(0.0, spacing)), 64)
    return BodyMesh(points, CellTable.from_arrays({"quad": quads}), np.arange(25 * 64, len(points)), np.arange(64))


def test_a_mesh_without_distributions_keeps_what_is_prepared() -> None:
    """Later coupling iterations use it: to prepare layers and turns again took several times as long as a step."""
    mesh = layered()
    full = MotionModel.build(mesh.points, mesh.cells, mesh.patches, Method())
    full.move(full.points, full.points[full.roles.moving])
    brief = full.without_distributions()
    assert not brief.distributions
    assert brief.carrying_layers is full.carrying_layers
    assert brief.winding is full.winding
    assert full.without_distributions() is brief
    assert full.carrying_layers.layer is not None
    assert full.motion_with(full.carrying_layers.layer) is full.carrying_layers


def turned(model: MotionModel, degrees: float) -> np.ndarray:
    rest, angle = model.points[model.roles.moving], np.radians(degrees)
    turn = np.eye(rest.shape[1])
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return rest if degrees == 0.0 else (rest - rest.mean(axis=0)) @ turn.T + rest.mean(axis=0)


def gone(model: MotionModel, angles: list[float], start: np.ndarray | None = None) -> Motion:
    points, factors = model.points if start is None else start, FactorCache(1 << 26)
    for degrees in angles:
        motion = model.move(points, turned(model, degrees), factors)
        points = motion.points
    return motion


@pytest.mark.parametrize(
    ("kind", "top", "sizes"), [("ring", 360.0, (15.0, 40.0, 90.0)), ("triangle", 240.0, (20.0, 80.0))]
)
def test_a_body_winds_in_any_number_of_steps_and_returns(kind: str, top: float, sizes: tuple[float, ...]) -> None:
    mesh = model(kind)
    steps = [list(np.linspace(0.0, top, round(top / size) + 1)[1:]) for size in sizes]
    wound = [gone(mesh, angles) for angles in steps]
    for motion in wound:
        np.testing.assert_allclose(motion.points, wound[0].points, atol=TOLERANCE)
        assert motion.corrected.metric.min > 0.0
        assert UNWOUND not in motion.warnings
    assert np.abs(wound[-1].points - gone(mesh, [top % 360.0 - 360.0]).points).max() > 0.1  # the same boundary
    back = gone(mesh, [*steps[-1][-2::-1], 0.0], wound[-1].points)
    np.testing.assert_array_equal(back.points, mesh.points)


def test_first_cells_that_the_correction_has_moved_turn_with_their_body() -> None:
    """They went back to where their wall carries them at the start of each step, and tangled the mesh."""
    mesh = ring()
    distance = np.linalg.norm(mesh.points, axis=1)
    points = mesh.points * np.stack([np.ones(len(distance)), np.interp(distance, [1.0, 10.0], [0.25, 1.0])], axis=1)
    ellipse = MotionModel.build(points, mesh.cells, mesh.patches, Method())
    assert ellipse.carrying_layers.layer is not None
    coarse, fine = gone(ellipse, [80.0, 160.0]), gone(ellipse, list(np.arange(20.0, 161.0, 20.0)))
    assert coarse.warnings == []
    assert fine.warnings == []
    np.testing.assert_allclose(fine.points, coarse.points, atol=TOLERANCE)
    far = gone(ellipse, [140.0, 220.0])  # each part of this step needs the resistance at its own turn
    assert UNWOUND not in far.warnings
    np.testing.assert_allclose(gone(ellipse, [180.0, 200.0, 220.0], fine.points).points, far.points, atol=TOLERANCE)


def test_nodes_in_space_turn_about_the_axis_of_their_body_at_the_start_of_a_step() -> None:
    mesh = model("tetra")
    rest, moving = mesh.points, mesh.roles.moving
    axis, centre = np.array([1.0, 1.0, 3.0]) / np.sqrt(11.0), rest[moving].mean(axis=0)
    plain = rest.copy()
    plain[moving] = Rotation.from_rotvec(np.radians(40.0) * axis).apply(rest[moving] - centre) + centre
    angles = np.radians([[100.0], [140.0]])
    carried = mesh.winding.carried(Turns(np.array([2]), *angles), rest, rest, plain, 0.0, 1.0)
    assert np.abs(carried - rest).max() > 0.05
    np.testing.assert_allclose((carried - centre) @ axis, (rest - centre) @ axis, atol=1e-14)
    np.testing.assert_allclose(*(np.linalg.norm(x - centre, axis=1) for x in (carried, rest)), atol=1e-14)


def test_200_degrees_are_not_minus_160() -> None:
    block = model("triangle")
    on, back = gone(block, [100.0, 200.0]), gone(block, [-80.0, -160.0])
    np.testing.assert_allclose(turned(block, 200.0), turned(block, -160.0), atol=1e-15)
    assert np.abs(on.points - back.points).max() > 0.1
    assert on.corrected.metric.min > 0.0
    assert back.corrected.metric.min > 0.0
    np.testing.assert_allclose(gone(block, [200.0]).points, back.points, atol=1e-6)  # one step: the smallest turn


def test_a_new_model_goes_on_from_the_turn_of_the_committed_mesh() -> None:
    block = model("triangle")
    committed = gone(block, [120.0, 220.0])
    resumed = MotionModel.build(
        block.points,
        block.cells,
        {"body": Patch("moving", block.roles.moving), "outer": Patch("fixed", block.roles.fixed)},
        Method(),
    )
    on, again = (one.move(committed.points, turned(one, 260.0)) for one in (block, resumed))
    np.testing.assert_array_equal(on.points, again.points)


@pytest.mark.nightly
def test_a_body_in_space_winds() -> None:
    box = model("tetra")
    on, other = gone(box, [66.0, 133.0, 200.0]), gone(box, [100.0, 200.0])
    assert on.corrected.metric.min > 0.0
    np.testing.assert_allclose(on.points, other.points, atol=TOLERANCE)
    assert np.abs(on.points - gone(box, [-80.0, -160.0]).points).max() > 0.1


def test_a_mesh_that_can_be_wound_no_further_says_so_and_goes_on() -> None:
    coarse = model("quad")
    points, said = coarse.points, []
    for degrees in range(40, 1100, 40):
        motion = coarse.move(points, turned(coarse, degrees))
        points = motion.points
        assert motion.corrected.inverted == 0
        said += [warning for warning in motion.warnings if warning == UNWOUND]
    assert said


def test_up_to_a_quarter_turn_nothing_is_wound_and_then_smoothly() -> None:
    angles = np.linspace(0.0, 3.0 * np.pi, 6001)
    found = np.array([wound(angle) for angle in angles])
    assert not found[angles <= np.pi / 2].any()
    np.testing.assert_allclose(found[angles >= 1.5 * np.pi], angles[angles >= 1.5 * np.pi])
    np.testing.assert_array_equal(found, [-wound(-angle) for angle in angles])
    assert np.abs(np.diff(found, 2)).max() < 4.0 * (angles[1] - angles[0]) ** 2


def bent(model: MotionModel, degrees: float, sideways: float) -> np.ndarray:
    """The body's nodes after a turn, a shift and a bend: its turn has to be fitted."""
    places, extent = turned(model, degrees), np.ptp(model.points, axis=0).max()
    return places + sideways * extent * np.sin(3.0 * model.points[model.roles.moving][:, ::-1] / extent + 0.4)


@pytest.mark.parametrize(
    ("kind", "steps", "resists"),
    [
        ("ring", [80.0, 120.0], True),
        ("ring", [80.0, 160.0, 200.0, 300.0], False),
        ("triangle", [80.0, 120.0], True),
        ("triangle", [-80.0, -160.0, -200.0], True),
        ("layered", [40.0, 80.0, 120.0], True),
        ("tetra", [60.0, 100.0], True),
        ("hexahedron", [60.0, 110.0], True),
    ],
)
def test_its_derivative_is_that_of_differences_and_its_transpose(kind: str, steps: list[float], resists: bool) -> None:
    block, factors = model(kind), FactorCache(1 << 26)
    moved = gone(block, steps).points
    moved = block.move(
        moved, bent(block, steps[-1], 0.002 if kind == "layered" or not resists else 0.021), factors
    ).points
    slope, moving = block.slope(moved, factors), block.roles.moving
    assert (block.carrying_layers.layer is not None) == (kind in ("layered", "ring"))
    assert slope.winding is not None
    assert slope.smooth is not None
    assert (slope.smooth.region is not None) == resists
    rest = block.points[moving]
    v = np.cos(2.0 * rest[:, ::-1]) + 0.5 * rest
    found = slope.tangent(v)

    def difference(h: float) -> np.ndarray:
        there, back = (block.move(moved, moved[moving] + s * h * v, factors).points for s in (1, -1))
        return (there - back) / (2.0 * h)

    exact = (4.0 * difference(1.5e-5) - difference(3e-5)) / 3.0
    assert np.abs(found - exact).max() < 1e-7 * np.abs(found).max()
    w = np.random.default_rng(3).standard_normal(block.points.shape)
    back = slope.cotangent(w)
    assert abs(np.sum(w * found) - np.sum(back * v)) < 1e-12 * (np.abs(w * found).sum() + np.abs(back * v).sum())
