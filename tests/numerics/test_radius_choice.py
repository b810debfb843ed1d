"""The support radius chosen from the motion: the best prediction wins, clearly, and by the motion's inputs alone."""

import numpy as np
import pytest

from docs.studies.moved_bodies import Turn, stored
from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.interpolation.support_radius import candidate_support_radii
from mesh_motion_server.numerics.mesh.roles import BoundaryRoles
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.motion.method_check import check_method
from mesh_motion_server.numerics.motion.motion import MotionModel
from mesh_motion_server.numerics.motion.motion_found import Motion
from mesh_motion_server.session.factors import FactorCache

BLOCKS = "tests/references/correction_two_blocks"
PLAIN = {"correction": "none", "allow_invalid": True}


def pressed(model: MotionModel, by: float) -> np.ndarray:
    """Two blocks, each ``by`` closer to the middle."""
    body = model.points[model.roles.moving]
    return body + np.column_stack([np.where(body[:, 0] < 0.5, by, -by), np.zeros(len(body))])


def press(by: float, **choices: object) -> Motion:
    model = stored(BLOCKS).model(**PLAIN | choices)
    return model.move(model.points, pressed(model, by))


def test_bodies_that_are_pressed_together_get_a_small_radius():
    chosen, of_mesh = press(0.1, support_radius_choice="motion"), press(0.1)
    assert chosen.support_radius < 0.2 * of_mesh.support_radius
    assert chosen.standard.metric.min > of_mesh.standard.metric.min + 0.05


def test_it_is_the_motion_with_that_radius_given_bitwise():
    chosen = press(0.1, support_radius_choice="motion")
    assert (chosen.points == press(0.1, support_radius=chosen.support_radius).points).all()


def test_no_candidate_is_clearly_better():
    model = stored(BLOCKS).model(**PLAIN)
    radii = candidate_support_radii(model.points, model.roles, model.method.support_radius)
    best = max(press(0.1, support_radius=radius).standard.metric.min for radius in radii)
    assert press(0.1, support_radius_choice="motion").standard.metric.min == best


def test_small_motions_and_turns_keep_the_radius_of_the_mesh():
    assert press(1e-6, support_radius_choice="motion").support_radius == press(1e-6).support_radius
    model = stored("tests/references/thesis_block").model(support_radius_choice="motion", **PLAIN)
    turned = model.move(model.points, Turn((0.0, 0.0), 50.0)(model.points[model.roles.moving]))
    assert turned.support_radius == model.method.support_radius == 2.5


def test_the_moves_before_do_not_matter_and_their_factorizations_are_shared():
    model = stored(BLOCKS).model(support_radius_choice="motion", displacement="absolute", **PLAIN)
    cache: FactorCache = FactorCache(1 << 30)
    first = model.move(model.points, pressed(model, 0.1), cache)
    made = cache.made["factorization"]
    assert model.move(model.points, pressed(model, 1e-6), cache).support_radius == 2.5
    again = model.move(first.points, pressed(model, 0.1), cache)
    assert cache.made["factorization"] == made == 4
    assert (again.points == first.points).all()
    assert again.caches["factorization"] == "reused"


def test_the_enrichment_radius_follows_unless_it_is_given():
    model = stored(BLOCKS).model(support_radius_choice="motion")
    radii = [(other.method.support_radius, other.method.enrichment_radius) for other in model.other_radii]
    assert radii == sorted(radii, reverse=True)
    assert all(of_enrichment == min(model.method.enrichment_radius, radius) for radius, of_enrichment in radii)
    given = stored(BLOCKS).model(support_radius_choice="motion", enrichment_radius=0.7)
    assert {other.method.enrichment_radius for other in given.other_radii} == {0.7}


def test_candidates_are_smaller_than_the_radius_and_scale_with_the_mesh():
    model = stored(BLOCKS).model()
    radii = candidate_support_radii(model.points, model.roles, 2.5)
    assert len(radii) == 3
    assert radii[1] == model.method.enrichment_radius
    scaled = candidate_support_radii(1e-3 * model.points, model.roles, 2.5e-3)
    assert scaled == pytest.approx(1e-3 * np.array(radii))
    assert candidate_support_radii(model.points, model.roles, radii[1]) == radii[2:]
    none = np.empty(0, dtype=np.int64)
    everywhere = BoundaryRoles(np.arange(len(model.points)), none, none, none)
    assert candidate_support_radii(model.points, everywhere, 2.5) == ()


@pytest.mark.parametrize(
    ("choices", "expected"),
    [
        ({"support_radius": 0.5}, "expected no support_radius, got 0.5"),
        ({"basis": "tps"}, "the basis 'tps' has no support radius"),
        ({"correction_in_time": "smooth", "displacement": "absolute"}, "expected support_radius_choice 'mesh'"),
    ],
)
def test_what_it_cannot_be_combined_with(choices, expected):
    mesh = stored(BLOCKS)
    with pytest.raises(InvalidInput, match=expected):
        check_method(
            Method(support_radius_choice="motion", **choices), mesh.points, BoundaryRoles.from_patches(mesh.patches)
        )
