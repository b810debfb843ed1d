"""One motion end to end: accepted and refused motions, their errors, and the inputs on which the answer depends."""

from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from correction_cases import rigid, stored
from frame_meshes import rotation, square_frame
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_motion_numerics.correction import trial_nodes
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.motion.motion_found import BoundaryDisplacement
from mesh_motion_numerics.motion.standard_motion import StandardMotion
from mesh_motion_numerics.quality.metrics import cell_quality
from mesh_motion_protocol.errors import InvalidInput, QualityRefused


def model_of(mesh=None, **choices) -> MotionModel:
    points, cells, patches = mesh or square_frame()
    return MotionModel.build(
        points, cells, patches, Method(**{"support_radius": 0.5, "quality_metric": "size-skew", **choices})
    )


def targets_of(model: MotionModel, degrees: float = 0.0, shift: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    return (model.points[model.roles.moving] - 0.5) @ rotation(degrees).T + 0.5 + shift


def test_a_large_motion_is_corrected_before_any_node_moves() -> None:
    model = model_of()
    motion = model.move(model.points, targets_of(model, 60.0, (-0.2, -0.2)))
    assert motion.standard.inverted > 0
    assert motion.corrected.inverted == 0
    assert motion.reached
    assert motion.corrected.metric.min > 0.3
    quality = cell_quality(motion.points, model.cells, model.reference_sizes).metric("size-skew")
    assert motion.corrected.metric.min == quality.min()
    assert motion.corrected.worst[0].number == int(np.argmin(quality))
    moving, fixed = model.roles.moving, model.roles.fixed
    assert np.array_equal(motion.points[moving], targets_of(model, 60.0, (-0.2, -0.2)))
    assert np.array_equal(motion.points[fixed], model.points[fixed])


@pytest.mark.parametrize(
    ("correction", "outer", "degrees", "shift", "motions"),
    [
        ("none", "fixed", 0.0, (0.7, 0.0), 1),
        ("none", "fixed", 0.0, (900.0, 0.0), 1),
        ("none", "fixed", 170.0, (0.0, 0.0), 1),
        ("smooth", "fixed", 0.0, (0.7, 0.0), 1),
        ("smooth", "fixed", 3.0, (0.65, 0.02), 1),
        ("smooth", "slip", 3.0, (0.65, 0.02), 3),  # not linear: the fraction's motion is made too, with held walls too
    ],
)
def test_a_refusal_takes_few_plain_motions(
    correction: str,
    outer: str,
    degrees: float,
    shift: tuple[float, float],
    motions: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """That to its targets shows what lies between."""
    model = model_of(square_frame(outer=outer), correction=correction)
    trial, made, targets = StandardMotion.trial, [], targets_of(model, degrees, shift)
    with monkeypatch.context() as counting:
        counting.setattr(StandardMotion, "trial", lambda self, *given: made.append(self) or trial(self, *given))
        with pytest.raises(QualityRefused) as refusal:
            model.move(model.points, targets)
    assert len(made) == motions
    rest, fraction = model.points[model.roles.moving], refusal.value.fraction
    assert (fraction > 0.0) == (shift[0] < 100.0)
    assert model.move(model.points, rest + fraction * (targets - rest)).corrected.inverted == 0


def test_the_fraction_needs_no_correction_where_the_boundary_forbids_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    model, descents = MotionModel.build(*square_frame(24), Method()), []
    descend = trial_nodes.newton
    monkeypatch.setattr(trial_nodes, "newton", lambda *a, **k: descents.append(1) or descend(*a, **k))
    rest, targets = model.points[model.roles.moving], targets_of(model, 3.0, (0.65, 0.02))
    with pytest.raises(QualityRefused, match="no valid mesh exists") as refusal:
        model.move(model.points, targets)
    assert not descents
    assert model.move(model.points, rest + refusal.value.fraction * (targets - rest)).corrected.inverted == 0


def test_a_boundary_that_crosses_itself_is_not_tried_in_other_ways(monkeypatch: pytest.MonkeyPatch) -> None:
    model, attempts = MotionModel.build(*square_frame(24), Method()), []
    for name in ("_attempt", "_smooth_attempt"):
        attempt = getattr(MotionModel, name)
        monkeypatch.setattr(
            MotionModel, name, lambda *a, name=name, attempt=attempt: attempts.append(name) or attempt(*a)
        )
    with pytest.raises(QualityRefused, match="no valid mesh exists"):
        model.move(model.points, targets_of(model, 3.0, (0.65, 0.02)))
    assert attempts == ["_smooth_attempt"]


# of the last one the bisection's own trial is valid, but not the motion itself, which frees all nodes
REFUSED = [((0.6, 0.04), -22.0), ((-0.49, 0.34), -65.0), ((0.57, 0.18), 49.0)]


@pytest.mark.parametrize(("shift", "degrees"), REFUSED)
@pytest.mark.parametrize("refuse_below_threshold", [False, True])
def test_the_fraction_of_a_refusal_is_accepted(
    shift: tuple[float, float], degrees: float, refuse_below_threshold: bool
) -> None:
    mesh = stored("correction_slab")
    model = model_of((mesh.points, mesh.cells, mesh.patches), refuse_below_threshold=refuse_below_threshold)
    rest = mesh.points[model.roles.moving]
    targets = rest + rigid(mesh, shift, degrees)[model.roles.moving]
    with pytest.raises(QualityRefused) as refusal:
        model.move(mesh.points, targets)
    assert 0.25 < refusal.value.fraction < 1.0
    accepted = model.move(mesh.points, rest + refusal.value.fraction * (targets - rest))
    assert accepted.corrected.metric.min >= (0.2 if refuse_below_threshold else 0.0)


@settings(max_examples=settings.default.max_examples // 16)
@given(
    seed=st.integers(0, 2**32 - 1),
    frame=st.sampled_from(["reference", "committed"]),
    asked=st.sampled_from(
        [{}, {"correction": "none"}, {"refuse_below_threshold": True}, {"quality_metric": "relative-size-skew"}]
    ),
)
def test_sending_back_the_fraction_of_a_refusal_is_accepted_in_either_frame(seed: int, frame: str, asked: Any) -> None:
    rng = np.random.default_rng(seed)
    mesh = stored("correction_slab")
    model = model_of((mesh.points, mesh.cells, mesh.patches), displacement="absolute", **asked)
    nodes = model.roles.moving
    first = mesh.points[nodes] + rigid(mesh, rng.uniform(-0.1, 0.1, 2), rng.uniform(-20, 20))[nodes]
    committed = model.move(mesh.points, first).points
    base = (mesh.points if frame == "reference" else committed)[nodes]
    displacement = mesh.points[nodes] + rigid(mesh, rng.uniform(-0.7, 0.7, 2), rng.uniform(-180, 180))[nodes] - base
    fraction = None
    with suppress(QualityRefused):
        try:
            model.move(committed, base + displacement, boundary_displacement=BoundaryDisplacement(base, displacement))
        except QualityRefused as refusal:
            fraction = refusal.fraction
            raise
        return
    assert fraction is not None
    assert float(f"{fraction:.3g}") == fraction
    if fraction > 0.0:
        assert model.move(committed, base + fraction * displacement) is not None


def test_a_radius_past_rounding_is_interpolated_in_levels() -> None:
    wide, usual = model_of(support_radius=1e9), model_of()
    targets = targets_of(wide, 5.0)
    moved = wide.move(wide.points, targets)
    np.testing.assert_array_equal(moved.points[wide.roles.moving], targets)
    assert moved.standard.metric.min > 0.8 * usual.move(usual.points, targets).standard.metric.min


def test_a_body_that_is_mirrored_is_refused_although_nothing_crosses() -> None:
    model = model_of()
    mirrored = targets_of(model) * [-1.0, 1.0] + [1.0, 0.0]
    with pytest.raises(
        QualityRefused, match="no valid mesh exists: the boundary would turn inside out near"
    ) as refused:
        model.move(model.points, mirrored)
    assert 0.0 < (refused.value.fraction or 0.0) < 0.5
    assert refused.value.cells


def test_plain_motion_that_inverts_cells_is_refused_unless_asked_for() -> None:
    model = model_of(correction="none")
    targets = targets_of(model, 60.0, (-0.2, -0.2))
    with pytest.raises(QualityRefused, match="inverted"):
        model.move(model.points, targets)
    kept = model_of(correction="none", allow_invalid=True).move(model.points, targets)
    assert kept.corrected.inverted > 0
    assert any("allow_invalid" in warning for warning in kept.warnings)


def test_below_the_threshold_but_valid_is_a_warning_or_where_asked_a_refusal() -> None:
    choices = {"correction": "none", "quality_threshold": 0.95}
    model = model_of(**choices)
    targets = targets_of(model, shift=(0.05, 0.0))
    motion = model.move(model.points, targets)
    assert not motion.reached
    assert "below the threshold 0.95" in motion.warnings[0]
    with pytest.raises(QualityRefused, match="below the threshold"):
        model_of(**choices, refuse_below_threshold=True).move(model.points, targets)


def test_size_is_relative_to_the_reference_mesh_whatever_was_committed() -> None:
    model = model_of()
    there = model.move(model.points, targets_of(model, shift=(0.1, 0.0)))
    stays = model.move(there.points, targets_of(model, shift=(0.1, 0.0)))
    assert np.array_equal(stays.points, there.points)
    assert stays.corrected.size.min == there.corrected.size.min < 1


def test_radii_are_chosen_from_the_mesh_when_none_is_given() -> None:
    points, cells, patches = square_frame()
    model = MotionModel.build(points, cells, patches, Method())
    assert (model.method.basis, model.method.support_radius) == ("wendland-c2-multiscale", 2.0)
    assert model.method.enrichment_radius == pytest.approx(0.45, abs=0.1)  # the ball in a corner


def test_a_periodic_patch_without_a_partner_is_refused_by_name() -> None:
    points, cells, patches = square_frame()
    patches = {**patches, "outer": replace(patches["outer"], role="periodic")}
    with pytest.raises(InvalidInput, match=r"'outer' has no partner"):
        MotionModel.build(points, cells, patches, Method())
