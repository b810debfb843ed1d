"""What all volume reductions have in common, and what they promise end to end."""

from __future__ import annotations

import numpy as np
import pytest
from frame_meshes import rotation, square_frame
from volume_problems import problem_of

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.interpolation.factor_source import MakeEachTime
from mesh_motion_server.numerics.method import CHOICES, Method
from mesh_motion_server.numerics.motion.motion import MotionModel
from mesh_motion_server.numerics.reduction.volume_reduction import (
    VOLUME_REDUCTIONS,
    VolumeProblem,
    volume_reduction_named,
)
from mesh_motion_server.numerics.stopwatch import Stopwatch

NAMES = sorted(VOLUME_REDUCTIONS)


def test_the_table_has_every_choice_of_the_method() -> None:
    assert CHOICES["volume_reduction"] == ("none", *VOLUME_REDUCTIONS)


def test_an_unknown_name_and_a_wrong_length_are_refused() -> None:
    with pytest.raises(InvalidInput, match=r"unknown volume reduction 'octree' .*enclosing-box"):
        volume_reduction_named("octree")
    for length in (0.0, -1.0, np.nan):
        with pytest.raises(InvalidInput, match="length > 0"):
            problem_of(length=length)
    with pytest.raises(InvalidInput, match="volume_reduction_length"):
        Method(volume_reduction_length=0.0)


def test_a_problem_without_moving_nodes_or_of_mixed_shapes_is_refused() -> None:
    whole = problem_of()
    parts = {name: getattr(whole, name) for name in whole.__dataclass_fields__}
    with pytest.raises(InvalidInput, match="needs a moving node"):
        VolumeProblem(**parts | {"moving": np.zeros_like(whole.moving)})
    with pytest.raises(InvalidInput, match="expected displacements of shape"):
        VolumeProblem(**parts | {"displacement": whole.displacement[1:]})


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("d", [1, 2, 3])
def test_the_moving_boundary_is_exact(name: str, d: int) -> None:
    problem = problem_of(d)
    found = VOLUME_REDUCTIONS[name](problem)(problem.boundary)
    np.testing.assert_allclose(found.displacement[problem.moving], 0.05, rtol=1e-10)
    np.testing.assert_allclose(found.displacement[~problem.moving], 0.0, atol=1e-10)


@pytest.mark.parametrize("name", NAMES)
def test_a_place_s_displacement_does_not_depend_on_the_others(name: str) -> None:
    problem = problem_of(length=0.25)
    field = VOLUME_REDUCTIONS[name](problem)
    whole = field(problem.nodes).displacement
    halves = [field(part).displacement for part in np.array_split(problem.nodes, 2)]
    assert np.array_equal(np.vstack(halves), whole)


@pytest.mark.parametrize("name", NAMES)
def test_it_tells_how_many_sums_it_took(name: str) -> None:
    problem = problem_of(length=0.25)
    found = VOLUME_REDUCTIONS[name](problem)(problem.nodes)
    assert 0 < np.count_nonzero(found.evaluated) <= found.places
    assert found.control_points >= np.count_nonzero(problem.moving)
    if name != "background-grid":
        assert found.places == np.count_nonzero(found.evaluated) < len(problem.nodes)
        assert not found.displacement[~found.evaluated].any()


def model_of(*, outer: str = "fixed", **choices) -> MotionModel:
    points, cells, patches = square_frame(30, outer=outer)
    return MotionModel.build(points, cells, patches, Method(**{"correction": "none", **choices}))


def targets_of(model: MotionModel, degrees: float, shift: tuple[float, float]) -> np.ndarray:
    return (model.points[model.roles.moving] - 0.5) @ rotation(degrees).T + 0.5 + shift


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("displacement", ["relative", "absolute", "reanchored"])
def test_a_motion_end_to_end_keeps_most_of_the_quality(name: str, displacement: str) -> None:
    plain = model_of(displacement=displacement)
    targets = targets_of(plain, 20.0, (0.03, 0.02))
    best = plain.move(plain.points, targets).corrected.metric.min
    model = model_of(displacement=displacement, volume_reduction=name)
    motion = model.move(model.points, targets)
    assert np.array_equal(motion.points[model.roles.moving], targets)
    assert np.array_equal(motion.points[model.roles.fixed], model.points[model.roles.fixed])
    assert motion.corrected.metric.min > 0.8 * best


@pytest.mark.parametrize("name", NAMES)
def test_many_small_relative_steps_do_not_wear_out_a_layer(name: str) -> None:
    model = model_of(volume_reduction=name)
    points = model.points
    for k in range(1, 21):
        points = model.move(points, targets_of(model, 0.0, (0.005 * k, 0.0))).points
    assert model.summary(points).metric.min > 0.5


@pytest.mark.parametrize("name", NAMES)
def test_corrections_start_from_the_reduced_motion(name: str) -> None:
    model = model_of(volume_reduction=name, correction="optimised")
    motion = model.move(model.points, targets_of(model, 60.0, (-0.1, -0.1)))
    assert motion.corrected.inverted == 0
    assert motion.corrected.metric.min > 0.25


@pytest.mark.parametrize("name", ["enclosing-box", "wall-function"])
def test_far_sliding_nodes_rest_and_near_ones_stay_on_their_side(name: str) -> None:
    model = model_of(outer="slip", volume_reduction=name, volume_reduction_length=0.25)
    motion = model.move(model.points, targets_of(model, 0.0, (0.05, 0.0)))
    assert np.array_equal(motion.points[model.roles.sliding], model.points[model.roles.sliding])
    wide = model_of(outer="slip", volume_reduction=name, volume_reduction_length=0.6)
    outer = wide.roles.sliding
    before, after = wide.points[outer], wide.move(wide.points, targets_of(wide, 0.0, (0.05, 0.0))).points[outer]
    for axis in (0, 1):
        on_side = (before[:, axis] == 0.0) | (before[:, axis] == 1.0)
        assert np.array_equal(after[on_side, axis], before[on_side, axis])
    assert np.abs(after - before).max() > 1e-5


@pytest.mark.parametrize("predictor", ["centre-gradient", "edge-midpoint-gradient"])
def test_predictors_that_need_a_gradient_are_refused(predictor: str) -> None:
    with pytest.raises(InvalidInput, match="a volume reduction does not give"):
        model_of(volume_reduction="wall-function", predictor=predictor)


def test_the_field_of_a_reduced_motion_is_that_of_its_nodes_and_has_no_gradient() -> None:
    model = model_of(volume_reduction="wall-function", volume_reduction_length=0.2)
    moved = model.move(model.points, targets_of(model, 10.0, (0.0, 0.0))).points
    trial = model.standard_motion.trial(model.points, targets_of(model, 10.0, (0.0, 0.0)), MakeEachTime(), Stopwatch())
    np.testing.assert_allclose(model.points + trial.field.displacement(model.points), moved, atol=1e-12)
    with pytest.raises(InvalidInput, match="has no gradient"):
        trial.field.gradient(model.points)
