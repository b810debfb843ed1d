"""Sub-steps: their length adapts, far motions become valid, impossible ones are refused, and easy motions stay single
steps.
"""

from functools import cache

import numpy as np
import pytest
from box_meshes import box_mesh
from correction_cases import REFERENCES, stored
from frame_meshes import rotation
from mesh_motion_numerics.interpolation.factor_source import MakeEachTime
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel, _Step
from mesh_motion_numerics.motion.motion_found import Motion
from mesh_motion_numerics.motion.sub_steps import Leg, furthest_walk, walk
from mesh_motion_numerics.quality.metrics import cell_quality
from mesh_motion_protocol.errors import InvalidInput, QualityRefused
from periodic_meshes import periodic_box
from sliding_meshes import duct


def box_model(kind: str = "quad", **choices) -> MotionModel:
    mesh = box_mesh(kind, 5 if kind == "tetra" else 10)
    method = Method(**{"support_radius": 0.5, "quality_metric": "size-skew", **choices})
    return MotionModel.build(mesh.points, mesh.cells, mesh.patches, method)


def turned(model: MotionModel, degrees: float, shift: float = 0.0) -> np.ndarray:
    x = model.points[model.roles.moving] - 0.5
    x[:, :2] = x[:, :2] @ rotation(degrees).T
    x[:, 0] += shift
    return x + 0.5


def led(model: MotionModel, targets: np.ndarray) -> Motion:
    """The motion in legs, as if one step had been refused."""
    return model._led(_Step(model.points, targets, MakeEachTime()))


@cache
def passing(bodies: str) -> dict[str, np.ndarray]:
    with np.load(REFERENCES / f"passing_{bodies}.npz") as data:
        return dict(data)


def passed(bodies: str, shift: float, **choices) -> tuple[MotionModel, np.ndarray]:
    """Two bodies, and their positions when each has moved past the other by ``shift``."""
    data = passing(bodies)
    names = {"outer": "fixed", "upper": "moving", "lower": "moving"}
    patches = {name: Patch(role, data[f"patch_{name}"]) for name, role in names.items()}
    cells = CellTable.from_arrays({"triangle": data["cells_triangle"]})
    model = MotionModel.build(data["points"], cells, patches, Method(**{"quality_metric": "size-skew", **choices}))
    points = model.points.copy()
    points[data["patch_upper"], 0] += shift
    points[data["patch_lower"], 0] -= shift
    return model, points[model.roles.moving]


class Line:
    """A mesh of one number; a move fails if it is longer than allowed at that place."""

    def __init__(self, longest: float, blocked: float = 2.0, easy: bool = True) -> None:
        self.longest, self.blocked, self.easy, self.tried = longest, blocked, easy, []

    def move(self, points: np.ndarray, target: np.ndarray) -> Leg:
        self.tried.append((float(points[0, 0]), float(target[0, 0])))
        if target[0, 0] - points[0, 0] > self.longest or target[0, 0] > self.blocked:
            raise QualityRefused("too far")
        return Leg(target, self.easy, 3)

    def walk(self, most: int = 16):
        return walk(np.zeros((1, 1)), lambda fraction: np.full((1, 1), fraction), self.move, most)


class TestWalk:
    def test_easy_legs_grow(self) -> None:
        line = Line(1.0)
        found = line.walk()
        assert line.tried == [(0.0, 0.25), (0.25, 0.75), (0.75, 1.0)]
        assert (found.fraction, found.legs, found.tries, found.iterations) == (1.0, 3, 3, 9)

    def test_hard_legs_do_not(self) -> None:
        assert Line(1.0, easy=False).walk().legs == 4

    def test_a_leg_that_fails_is_halved(self) -> None:
        line = Line(0.13, easy=False)
        found = line.walk()
        assert line.tried[:3] == [(0.0, 0.25), (0.0, 0.125), (0.125, 0.25)]
        assert (found.fraction, found.legs, found.tries) == (1.0, 8, 9)
        assert found.points[0, 0] == 1.0

    def test_it_gets_as_close_to_an_obstacle_as_the_shortest_leg(self) -> None:
        found = Line(1.0, blocked=0.7).walk()
        assert 0.7 - 1 / 8 < found.fraction <= 0.7
        assert found.tries < 10

    def test_the_tries_are_bounded(self) -> None:
        found = Line(1 / 8).walk(most=5)
        assert found.tries == 5
        assert found.fraction < 1.0

    def test_where_no_leg_succeeds_the_start_is_left(self) -> None:
        found = Line(0.001).walk()
        assert (found.fraction, found.legs, found.tries) == (0.0, 0, 2)
        assert found.points[0, 0] == 0.0

    def test_a_leg_cut_by_the_end_is_halved_as_it_was_tried(self) -> None:
        line = Line(1.0, blocked=0.9)
        line.walk()
        assert line.tried[2:4] == [(0.75, 1.0), (0.75, 0.875)]


@pytest.mark.parametrize(("kind", "degrees", "at_least"), [("quad", 180.0, 0.45), ("quad + triangle", 180.0, 0.17)])
def test_half_a_turn_in_one_move(kind: str, degrees: float, at_least: float) -> None:
    model = box_model(kind)
    targets = turned(model, degrees)
    with pytest.raises(QualityRefused, match="no valid mesh found"):
        box_model(kind, sub_steps="never").move(model.points, targets)
    motion = model.move(model.points, targets)
    assert motion.sub_steps > 1
    assert motion.corrected.metric.min > at_least
    quality = cell_quality(motion.points, model.cells, model.reference_sizes)
    assert not quality.inverted.any()
    assert quality.metric("size-skew").min() == motion.corrected.metric.min
    assert motion.standard.inverted > 0  # what one plain step would have done
    assert np.array_equal(motion.points[model.roles.moving], targets)
    assert np.array_equal(motion.points[model.roles.fixed], model.points[model.roles.fixed])


def test_hexahedra_take_half_a_turn_without_sub_steps() -> None:
    model = box_model("hexahedron")
    motion = model.move(model.points, turned(model, 180.0))
    assert motion.sub_steps == 1
    assert motion.corrected.metric.min > 0.65
    assert motion.standard.inverted > 0


@pytest.mark.parametrize(
    ("bodies", "shift", "at_least"), [("blocks", 0.5, 0.03), ("blocks", 0.7, 0.06), ("ellipses", 1.0, 0.13)]
)
def test_bodies_pass_each_other(bodies: str, shift: float, at_least: float) -> None:
    model, targets = passed(bodies, shift)
    motion = model.move(model.points, targets)
    assert motion.corrected.metric.min > at_least
    assert led(model, targets).corrected.metric.min > at_least


def test_bodies_change_places() -> None:
    model, _ = passed("blocks", 0.0)
    data, points = passing("blocks"), model.points.copy()
    points[data["patch_upper"]] += (0.8, -0.26)
    points[data["patch_lower"]] -= (0.8, -0.26)
    motion = led(model, points[model.roles.moving])
    assert motion.corrected.metric.min > 0.05


def test_a_squeeze_to_a_tenth_of_the_gap_is_valid_directly_and_in_sub_steps() -> None:
    mesh = stored("thesis_block")
    method = Method(support_radius=0.5, quality_metric="size-skew", sub_steps="never")
    model = MotionModel.build(mesh.points, mesh.cells, mesh.patches, method)
    targets = turned(model, 0.0, -0.9 * model.points[model.roles.moving, 0].min())
    for motion in (model.move(model.points, targets), led(model, targets)):
        assert motion.corrected.metric.min > 0.06


def test_a_mesh_that_is_only_carried_stays_as_it_is() -> None:
    mesh = stored("correction_slab")
    patches = {"all": Patch("moving", np.flatnonzero(mesh.held))}
    model = MotionModel.build(mesh.points, mesh.cells, patches, Method(support_radius=0.5, correction="optimised"))
    motion = led(model, turned(model, 180.0))
    assert motion.sub_steps == 3
    np.testing.assert_allclose(motion.points, 1.0 - model.points, atol=1e-13)


def test_an_easy_motion_is_the_same_with_and_without() -> None:
    auto, never = box_model(), box_model(sub_steps="never")
    for degrees in (10.0, 100.0):
        targets = turned(auto, degrees)
        first, second = auto.move(auto.points, targets), never.move(auto.points, targets)
        assert np.array_equal(first.points, second.points)
        assert first.sub_steps == second.sub_steps == 1


def test_from_the_reference_mesh_the_way_does_not_matter() -> None:
    model = box_model(displacement="absolute")
    targets = turned(model, 180.0)
    straight = model.move(model.points, targets)
    assert straight.sub_steps > 1
    assert straight.corrected.metric.min > 0.15
    elsewhere = model.move(model.points, turned(model, 30.0, 0.1)).points
    assert np.array_equal(model.move(elsewhere, targets).points, straight.points)


@pytest.mark.parametrize(("correction", "at_least"), [("explicit", 1e-3), ("enrichment", 0.15)])
def test_every_correction_goes_in_sub_steps(correction: str, at_least: float) -> None:
    mesh = stored("thesis_block")
    method = Method(correction=correction, quality_metric="size-skew")
    model = MotionModel.build(mesh.points, mesh.cells, mesh.patches, method)
    motion = led(model, turned(model, 180.0))
    assert motion.sub_steps >= 3
    assert motion.corrected.metric.min > at_least


def test_a_motion_that_sub_steps_do_not_reach_is_refused_with_the_fraction() -> None:
    model = box_model("tetra")
    with pytest.raises(QualityRefused, match=r"sub-steps the mesh was kept valid for 0\.\d+ of the way") as refusal:
        model.move(model.points, turned(model, 180.0, 0.2))
    assert 0.3 < refusal.value.fraction < 1.0
    assert refusal.value.cells
    assert refusal.value.best <= 0.0


@pytest.mark.parametrize(
    ("motion", "fault", "fraction"),
    [
        ((0.0, 0.7), "the boundary would leave its side of another part near", (0.3, 0.4 / 0.7)),  # beyond the wall
        ((20.0, 0.44), r"no valid mesh exists: the boundary would cross itself near \(1\.", (0.4, 1.0)),  # in the wall
    ],
)
def test_a_boundary_that_no_mesh_follows_is_refused_at_once(
    motion: tuple[float, float], fault: str, fraction: tuple[float, float]
) -> None:
    model = box_model()
    with pytest.raises(QualityRefused, match=fault) as refusal:
        model.move(model.points, turned(model, *motion))
    assert "sub-steps" not in refusal.value.message
    assert fraction[0] < refusal.value.fraction < fraction[1]
    assert refusal.value.cells


def test_an_asked_for_threshold_is_refused_after_sub_steps_too() -> None:
    model, targets = passed("blocks", 0.5, refuse_below_threshold=True)
    with pytest.raises(QualityRefused, match=r"minimum size-skew 0\.0\d+ stays below the threshold"):
        model.move(model.points, targets)


def test_the_first_way_that_leads_to_its_end_is_taken() -> None:
    lines = [Line(1.0, blocked=b) for b in (0.5, 0.3, 2.0, 2.0)]

    def move(points: np.ndarray, target: np.ndarray) -> Leg:
        return lines[round(float(target[0, 1]))].move(points, target)

    def places(number: int):
        return lambda fraction: np.array([[fraction, float(number)]])

    start = np.zeros((1, 2))
    assert furthest_walk(start, [places(i) for i in range(4)], move).points.tolist() == [[1.0, 2.0]]
    assert lines[3].tried == []
    blocked = furthest_walk(start, [places(0), places(1)], move)
    assert blocked.fraction == 0.5
    assert blocked.refusal is not None
    with pytest.raises(InvalidInput, match="at least one way"):
        furthest_walk(start, [], move)


def test_walls_that_slide_are_followed_in_every_leg() -> None:
    points, cells, patches = duct("quad")
    method = Method(support_radius=1.0, quality_threshold=0.9, correction="optimised")
    model = MotionModel.build(points, cells, patches, method)
    motion = led(model, turned(model, 120.0, 0.1))
    assert motion.sub_steps >= 3
    assert motion.corrected.metric.min > 0.2
    walls = model.roles.sliding
    assert np.array_equal(motion.points[walls, 1], model.points[walls, 1])
    assert np.abs(motion.points[walls, 0] - model.points[walls, 0]).max() > 1e-3


def test_periodic_nodes_stay_pairs_in_every_leg() -> None:
    method = Method(support_radius=0.8, quality_threshold=0.9, correction="optimised")
    model = MotionModel.build(*periodic_box("quad"), method)
    motion = led(model, model.points[model.roles.moving] + (0.1, 0.25))
    assert motion.sub_steps == 3
    assert motion.corrected.metric.min > 0.3
    periodic = model.standard_motion.periodic
    step = motion.points - model.points
    np.testing.assert_allclose(step[periodic.members], step[periodic.roots], atol=1e-12)
