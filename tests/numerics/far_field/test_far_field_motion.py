"""``far_field_tolerance`` through the real path: the boundary exact, all nodes within the tolerance."""

import numpy as np
import pytest
from tiny_meshes import tiny_mesh

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.interpolation.evaluation import LocalEvaluator
from mesh_motion_server.numerics.interpolation.far_field import evaluator as module
from mesh_motion_server.numerics.interpolation.far_field.evaluator import FarFieldEvaluator
from mesh_motion_server.numerics.interpolation.interpolant import factorize
from mesh_motion_server.numerics.mesh.roles import Patch
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.motion.motion import MotionModel

POINTS, CELLS = tiny_mesh("triangle", 60)


def model(**choices):
    rim = (POINTS == 0.0).any(axis=1) | (POINTS == 1.0).any(axis=1)
    middle = np.linalg.norm(POINTS - 0.5, axis=1) < 0.12
    patches = {"body": Patch("moving", np.flatnonzero(middle)), "rim": Patch("fixed", np.flatnonzero(rim))}
    return MotionModel.build(POINTS, CELLS, patches, Method(correction="none", **choices))


def moved(motion_model):
    targets = POINTS[motion_model.roles.moving] + [0.1, 0.04]
    return motion_model.move(POINTS, targets).points, targets


@pytest.fixture
def planned(monkeypatch):
    """What was planned, even where it does not pay."""
    found = []
    build = module.FarSum.build

    def recorded(*arguments, **options):
        found.append(build(*arguments, **options))
        return found[-1]

    monkeypatch.setattr(module, "_SMALL", 0.0)
    monkeypatch.setattr(module, "_WORTHWHILE", np.inf)
    monkeypatch.setattr(module.FarSum, "build", recorded)
    return found


@pytest.mark.parametrize("displacement", ["relative", "reanchored"])
@pytest.mark.parametrize("choices", [{"basis": "tps"}, {"support_radius": 2.0, "solver": "dense"}])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-5])
def test_every_node_is_within_the_tolerance_and_the_boundary_exact(tolerance, choices, displacement, planned):
    exact, targets = moved(model(displacement=displacement, **choices))
    assert planned == []
    with_far_field = model(displacement=displacement, far_field_tolerance=tolerance, **choices)
    found, _ = moved(with_far_field)
    assert planned
    assert any(len(far.plan.far.box) for far in planned)
    largest = np.hypot(0.1, 0.04)
    assert np.linalg.norm(found - exact, axis=1).max() <= tolerance * largest * 1.01  # sub-steps start from moved nodes
    assert found[with_far_field.roles.moving].tobytes() == targets.tobytes()
    fixed = with_far_field.roles.fixed
    assert found[fixed].tobytes() == POINTS[fixed].tobytes()


def test_reduced_interpolations_share_the_tolerance(planned):
    choices = {"support_radius": 2.0, "reduction": "greedy", "reduction_tolerance": 1e-2}
    exact, _ = moved(model(**choices))
    found, _ = moved(model(far_field_tolerance=1e-3, **choices))
    assert len(planned) > 1
    assert np.linalg.norm(found - exact, axis=1).max() <= 1e-3 * np.hypot(0.1, 0.04)


@pytest.mark.parametrize("correction", ["enrichment", "optimised"])
@pytest.mark.parametrize("predictor", ["centre-gradient", "sampled"])
def test_predictors_and_corrections_work_with_it(correction, predictor, planned):
    chosen = {"basis": "tps", "predictor": predictor, "quality_threshold": 0.6}
    rim = (POINTS == 0.0).any(axis=1) | (POINTS == 1.0).any(axis=1)
    middle = np.linalg.norm(POINTS - 0.5, axis=1) < 0.12
    patches = {"body": Patch("moving", np.flatnonzero(middle)), "rim": Patch("fixed", np.flatnonzero(rim))}
    worst = []
    for tolerance in (0.0, 1e-6):
        method = Method(correction=correction, far_field_tolerance=tolerance, **chosen)
        built = MotionModel.build(POINTS, CELLS, patches, method)
        motion = built.move(POINTS, POINTS[built.roles.moving] + [0.1, 0.04])
        worst.append(motion.standard.metric.min)
    assert planned
    assert worst[0] == pytest.approx(worst[1], rel=1e-3)


def test_small_sums_and_those_that_need_no_less_are_the_direct_ones():
    evaluator, direct = FarFieldEvaluator(1e-3), LocalEvaluator()
    stage = model(basis="tps").standard_motion
    assert isinstance(stage.evaluator, LocalEvaluator)
    assert not isinstance(stage.evaluator, FarFieldEvaluator)
    interpolant = factorize(POINTS[::50], basis="tps", support_radius=None).solve(POINTS[::50] ** 2)
    assert evaluator.displacement(interpolant, POINTS).tobytes() == direct.displacement(interpolant, POINTS).tobytes()
    assert evaluator.gradient(interpolant, POINTS).tobytes() == direct.gradient(interpolant, POINTS).tobytes()


def test_two_scales_have_no_use_for_it():
    with pytest.raises(InvalidInput, match=r"far_field_tolerance = 0\.001 is for sums in one scale"):
        model(support_radius=2.0, solver="two-scale", far_field_tolerance=1e-3)


@pytest.mark.parametrize("tolerance", [-1e-9, 1.0, float("nan")])
def test_a_tolerance_is_a_share(tolerance):
    with pytest.raises(InvalidInput, match="far_field_tolerance must be a number from 0 to below 1"):
        Method(far_field_tolerance=tolerance)
