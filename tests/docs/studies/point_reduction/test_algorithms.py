"""Promises of all reduction algorithms, and their differences (thesis §2.2.2, §2.2.3)."""

import numpy as np
import pytest
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.reduction import ReductionProblem
from mesh_motion_protocol.errors import InvalidInput
from reduced_motions import BOUNDARIES, field_at_nodes, problem

from docs.studies.thesis._point_reduction import REDUCTIONS

GREEDY = ("greedy", "one-point", "greedy-combined", "error-peaks", "incremental-lu", "recurrence-cholesky")
#: These choose exactly as the full greedy algorithm does.
EXACT = ("incremental-lu", "recurrence-cholesky")
#: By groups, levels and grids.
LEVELS = ("grouped-circular", "multilevel-subspace", "multi-step", "multiscale", "grid-clustering")
#: Their levels have radii of their own.
WITH_RADII = ("multi-step", "multiscale")


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("name", REDUCTIONS)
@pytest.mark.parametrize("tolerance", [1e-1, 1e-2, 1e-3])
def test_the_tolerance_is_met_and_the_error_is_the_fields(name: str, boundary: str, tolerance: float) -> None:
    of = problem(boundary, tolerance=tolerance)
    reduced = REDUCTIONS[name](of)
    left = of.displacement - field_at_nodes(reduced, of)
    np.testing.assert_allclose(reduced.error, left, atol=1e-11 * of.largest)
    assert np.linalg.norm(left, axis=1).max() <= tolerance * of.largest * (1 + 1e-9)
    if name in GREEDY:
        assert reduced.max_error > 0.05 * tolerance * of.largest  # no more points than needed, by far


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("name", GREEDY)
def test_with_tolerance_zero_it_is_the_full_interpolation(name: str, boundary: str) -> None:
    of = problem(boundary, tolerance=0.0)
    of = ReductionProblem(of.points[::3], of.displacement[::3], support_radius=of.support_radius, tolerance=0.0)
    reduced = REDUCTIONS[name](of)
    assert sorted(reduced.selected) == list(range(of.n_points))
    full = factorize(of.points, support_radius=of.support_radius).solve(of.displacement).weights
    np.testing.assert_allclose(reduced.levels[0].weights, full[reduced.selected], atol=1e-8 * np.abs(full).max())


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("name", LEVELS)
def test_with_tolerance_zero_every_node_is_reproduced(name: str, boundary: str) -> None:
    of = problem(boundary, tolerance=0.0)
    reduced = REDUCTIONS[name](of)
    assert reduced.max_error <= 1e-10 * of.largest
    if name != "multilevel-subspace":  # which is exact in all nodes as soon as it gives levels up
        assert sorted(reduced.selected) == list(range(of.n_points))


@pytest.mark.parametrize("name", GREEDY)
def test_selection_is_monotone_without_duplicates_and_starts_at_the_largest_displacement(name: str) -> None:
    """A smaller bound gives a prefix of the choice."""
    reduced, less = (REDUCTIONS[name](problem("wing", tolerance=0.0, max_points=m)) for m in (80, 40))
    of = problem("wing")
    assert len(np.unique(reduced.selected)) == len(reduced.selected) == 80
    np.testing.assert_array_equal(reduced.selected[:40], less.selected)
    assert np.linalg.norm(of.displacement[reduced.selected[0]]) == pytest.approx(of.largest, rel=1e-15)


@pytest.mark.parametrize("name", LEVELS)
def test_no_more_nodes_are_selected_than_allowed(name: str) -> None:
    reduced = REDUCTIONS[name](problem("wing", tolerance=1e-6, max_points=60))
    assert 55 <= len(reduced.selected) <= 60
    assert len(np.unique(reduced.selected)) == len(reduced.selected)


@pytest.mark.parametrize("name", REDUCTIONS)
def test_the_history_grows_and_ends_with_the_error_of_the_selected_nodes(name: str) -> None:
    of = problem("wing", tolerance=1e-2)
    reduced = REDUCTIONS[name](of)
    operations = [(iterate.solve_operations, iterate.error_operations) for iterate in reduced.history]
    assert operations == sorted(operations)
    if name in GREEDY:
        points = [iterate.points for iterate in reduced.history]
        assert points == sorted(points)
    centres = np.concatenate([level.control_points for level in reduced.levels])
    assert {tuple(x) for x in centres} == {tuple(x) for x in of.points[reduced.selected]}
    last, rounding = reduced.history[-1], 1e-9 if name in GREEDY else 1e-12
    assert last.points == len(reduced.selected)
    assert last.max_error == pytest.approx(reduced.max_error, rel=rounding)


@pytest.mark.parametrize("name", REDUCTIONS)
def test_a_motion_of_nothing_needs_next_to_nothing(name: str) -> None:
    of = problem("slab")
    still = ReductionProblem(of.points, np.zeros_like(of.displacement), support_radius=of.support_radius)
    reduced = REDUCTIONS[name](still)
    assert reduced.max_error == 0.0
    assert len(reduced.selected) == 1 or name not in GREEDY
    assert not any(level.weights.any() for level in reduced.levels)


@pytest.mark.parametrize("name", sorted({*REDUCTIONS} - {*WITH_RADII}))
def test_other_bases_reduce_too(name: str) -> None:
    of = problem("slab", basis="imqb", support_radius=0.1, tolerance=1e-3)
    assert REDUCTIONS[name](of).max_error <= of.allowed_error


@pytest.mark.parametrize("name", WITH_RADII)
def test_radii_mean_nothing_without_a_compact_support(name: str) -> None:
    with pytest.raises(InvalidInput, match="compact support, not 'imqb'"):
        REDUCTIONS[name](problem("slab", basis="imqb"))


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("name", EXACT)
def test_growing_factors_choose_as_full_solutions_do(name: str, boundary: str) -> None:
    of = problem(boundary, tolerance=1e-3)
    full, growing = REDUCTIONS["greedy"](of), REDUCTIONS[name](of)
    np.testing.assert_array_equal(growing.selected, full.selected)
    largest = np.abs(full.levels[0].weights).max()
    np.testing.assert_allclose(growing.levels[0].weights, full.levels[0].weights, atol=1e-9 * largest)
    errors = [[iterate.max_error for iterate in reduced.history] for reduced in (growing, full)]
    np.testing.assert_allclose(*errors, rtol=1e-7)


def test_approximate_choices_cost_points() -> None:
    """The order of thesis Fig 2.6: the full algorithm needs the fewest points, one-point corrections alone the most."""
    full, combined, one = (
        len(REDUCTIONS[name](problem("wing", tolerance=5e-3)).selected)
        for name in ("greedy", "greedy-combined", "one-point")
    )
    assert full < combined < one


@pytest.mark.parametrize("name", GREEDY)
def test_the_energy_of_the_interpolant_grows_with_its_points(name: str) -> None:
    """dᵀ φ⁻¹ d of nested sets, although the largest error may rise for a while."""
    energies = []
    for bound in (5, 10, 20, 40, 80):
        of = problem("wing", tolerance=0.0, max_points=bound)
        reduced = REDUCTIONS[name](of)
        energies.append(float(np.sum(reduced.levels[0].weights * of.displacement[reduced.selected])))
    assert (np.diff(energies) > 0.0).all()
