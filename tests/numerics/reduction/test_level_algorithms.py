"""What the algorithms by groups, levels and grids promise alike."""

import numpy as np
import pytest
from reduced_motions import BOUNDARIES, field_at_nodes, problem

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.reduction import REDUCTIONS

NAMES = ("grouped-circular", "multilevel-subspace", "multi-step", "multiscale", "grid-clustering")
LEVELLED = ("multi-step", "multiscale")


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("tolerance", [1e-1, 1e-2, 1e-3])
def test_the_tolerance_is_met_and_the_error_is_the_fields(name: str, boundary: str, tolerance: float) -> None:
    of = problem(boundary, tolerance=tolerance)
    reduced = REDUCTIONS[name](of)
    left = of.displacement - field_at_nodes(reduced, of)
    np.testing.assert_allclose(reduced.error, left, atol=1e-11 * of.largest)
    assert np.linalg.norm(left, axis=1).max() <= tolerance * of.largest * (1 + 1e-9)


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("name", NAMES)
def test_with_tolerance_zero_every_node_is_reproduced(name: str, boundary: str) -> None:
    of = problem(boundary, tolerance=0.0)
    reduced = REDUCTIONS[name](of)
    assert reduced.max_error <= 1e-10 * of.largest
    if name != "multilevel-subspace":  # which is exact in all nodes as soon as it gives levels up
        assert sorted(reduced.selected) == list(range(of.n_points))


@pytest.mark.parametrize("name", NAMES)
def test_no_more_nodes_are_selected_than_allowed(name: str) -> None:
    reduced = REDUCTIONS[name](problem("wing", tolerance=1e-6, max_points=60))
    assert 55 <= len(reduced.selected) <= 60
    assert len(np.unique(reduced.selected)) == len(reduced.selected)


@pytest.mark.parametrize("name", NAMES)
def test_levels_stand_on_the_selected_nodes_and_the_history_ends_with_the_error(name: str) -> None:
    of = problem("wing", tolerance=1e-2)
    reduced = REDUCTIONS[name](of)
    centres = np.concatenate([level.control_points for level in reduced.levels])
    assert {tuple(x) for x in centres} == {tuple(x) for x in of.points[reduced.selected]}
    last = reduced.history[-1]
    assert last.points == len(reduced.selected)
    assert last.max_error == pytest.approx(reduced.max_error, rel=1e-12)
    assert last.rms_error == pytest.approx(np.sqrt(np.mean(np.sum(reduced.error**2, axis=1))), rel=1e-12)
    operations = [(i.solve_operations, i.error_operations) for i in reduced.history]
    assert operations == sorted(operations)


@pytest.mark.parametrize("name", NAMES)
def test_a_second_run_is_bitwise_the_same(name: str) -> None:
    first, second = (REDUCTIONS[name](problem("wing", tolerance=1e-2)) for _ in range(2))
    np.testing.assert_array_equal(first.selected, second.selected)
    np.testing.assert_array_equal(first.error, second.error)


@pytest.mark.parametrize("name", NAMES)
def test_a_motion_of_nothing_needs_next_to_nothing(name: str) -> None:
    of = problem("slab")
    still = type(of)(of.points, np.zeros_like(of.displacement), support_radius=of.support_radius)
    reduced = REDUCTIONS[name](still)
    assert reduced.max_error == 0.0
    assert not any(level.weights.any() for level in reduced.levels)


@pytest.mark.parametrize("name", NAMES)
def test_components_may_be_few_and_nodes_may_be_few(name: str) -> None:
    points = np.array([[0.0], [1.0], [1.5]])
    of = type(problem("slab"))(points, np.array([[0.1], [0.0], [-0.2]]), support_radius=2.0, tolerance=1e-12)
    assert REDUCTIONS[name](of).max_error <= 1e-13


@pytest.mark.parametrize("name", LEVELLED)
def test_radii_mean_nothing_without_a_compact_support(name: str) -> None:
    with pytest.raises(InvalidInput, match="compact support, not 'imqb'"):
        REDUCTIONS[name](problem("slab", basis="imqb"))


@pytest.mark.parametrize("name", sorted(set(NAMES) - set(LEVELLED)))
def test_other_bases_reduce_too(name: str) -> None:
    of = problem("slab", basis="imqb", support_radius=0.1, tolerance=1e-3)
    assert REDUCTIONS[name](of).max_error <= of.allowed_error
