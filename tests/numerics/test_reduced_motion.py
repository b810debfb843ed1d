"""Motions from few control points in the real motion: exact boundaries, sliding nodes, corrections, caches."""

import numpy as np
import pytest
from frame_meshes import rotation, square_frame
from mesh_motion_numerics.interpolation.factor_source import DeferredFactorization, MakeEachTime
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.motion.standard_motion import StandardTrial
from mesh_motion_numerics.reduction import REDUCTIONS
from mesh_motion_numerics.reduction.reduced_motion import interpolate_reduced
from mesh_motion_numerics.stopwatch import Stopwatch
from trial_stages import displacement_by

from mesh_motion_server.session.factors import FactorCache


def model_of(outer: str = "fixed", **choices) -> MotionModel:
    points, cells, patches = square_frame(25, outer=outer)
    method = Method(
        **{"support_radius": 2.5, "correction": "none", "quality_metric": "size-skew", "allow_invalid": True, **choices}
    )
    return MotionModel.build(points, cells, patches, method)


def turned(model: MotionModel, degrees: float = 15.0, shift: tuple[float, float] = (0.06, 0.03)) -> np.ndarray:
    return (model.points[model.roles.moving] - 0.5) @ rotation(degrees).T + 0.5 + shift


@pytest.mark.parametrize("reduction", REDUCTIONS)
@pytest.mark.parametrize("displacement", ["relative", "absolute", "reanchored"])
@pytest.mark.parametrize("outer", ["fixed", "slip"])
def test_the_boundary_is_exact_and_the_mesh_that_of_the_full_interpolation(
    reduction: str, displacement: str, outer: str
) -> None:
    choices = {"displacement": displacement, "support_radius": 0.5}
    full, model = model_of(outer, **choices), model_of(outer, **choices, reduction=reduction)
    targets = turned(model)
    motion, expected = model.move(model.points, targets), full.move(full.points, targets)
    assert np.array_equal(motion.points[model.roles.moving], targets)
    assert np.array_equal(motion.points[model.roles.fixed], model.points[model.roles.fixed])
    assert np.isin(motion.control_points, model.roles.all).all()
    assert np.array_equal(expected.control_points, model.roles.all)
    assert 0 < len(motion.control_points) < len(model.roles.all)
    largest = np.linalg.norm(targets - model.points[model.roles.moving], axis=1).max()
    assert np.abs(motion.points - expected.points).max() < 0.05 * largest
    assert motion.standard.metric.min > 0.9 * expected.standard.metric.min > 0.0


@pytest.mark.parametrize("reduction", REDUCTIONS)
def test_a_mesh_carried_as_a_whole_is_reproduced(reduction: str) -> None:
    model = model_of("moving", reduction=reduction)
    targets = turned(model, 60.0, (0.4, -0.2))
    moved = model.move(model.points, targets).points
    np.testing.assert_allclose(moved, (model.points - 0.5) @ rotation(60.0).T + 0.5 + (0.4, -0.2), atol=2e-14)


@pytest.mark.parametrize("correction", ["optimised", "enrichment", "explicit"])
def test_corrections_work_on_a_reduced_motion(correction: str) -> None:
    model = model_of(
        reduction="grouped-circular",
        correction_target="threshold",
        correction=correction,
        quality_threshold=0.3,
        enrichment_radius=0.5,
        support_radius=0.5,
    )
    targets = turned(model, 35.0, (0.1, 0.1))
    motion = model.move(model.points, targets)
    assert motion.corrected.metric.min > motion.standard.metric.min
    assert np.array_equal(motion.points[model.roles.moving], targets)
    assert motion.correction.method == correction


def trial_of(model: MotionModel, **choices) -> StandardTrial:
    return model.standard_motion.trial(model.points, turned(model, **choices), MakeEachTime(), Stopwatch())


def test_the_field_itself_is_exact_at_the_boundary() -> None:
    """The near-surface correction keeps the layers; setting the nodes alone does not."""
    model = model_of(reduction="greedy")
    trial = trial_of(model)
    moving = model.roles.moving
    prescribed = turned(model) - model.points[moving]
    assert len(trial.stages[0].further) == 1
    np.testing.assert_allclose(displacement_by(trial, model.points[moving]), prescribed, atol=1e-11)


def test_the_boundarys_factorization_is_made_only_for_a_correction_that_asks() -> None:
    model = model_of(reduction="greedy")
    cache: FactorCache = FactorCache(1 << 28)
    first = model.move(model.points, turned(model), cache)
    again = model.move(model.points, turned(model), cache)
    assert (first.caches["factorization"], again.caches["factorization"]) == ("made", "reused")
    assert len(cache) == 1
    assert np.array_equal(first.points, again.points)
    trial = model.standard_motion.trial(model.points, turned(model), cache, Stopwatch())
    assert isinstance(trial.factorization, DeferredFactorization)
    assert len(cache) == 1
    assert trial.factorization.solve(np.zeros((len(model.roles.all), 2))).support_radius == 2.5
    assert len(cache) == 2


def test_all_nodes_leave_nothing_to_correct() -> None:
    points = np.random.default_rng(1).random((20, 2))
    method = Method(support_radius=2.0, reduction="greedy")
    found = interpolate_reduced(points[:3], points[:3] ** 2, method, MakeEachTime(), spacing=0.1)
    assert len(found.levels) == 1
