"""Optimised enrichment: the space it works in, and what it reaches."""

import numpy as np
import pytest
from correction_cases import CASES, RADIUS, case, stored

from mesh_motion_server.numerics.enrichment import coefficients as module
from mesh_motion_server.numerics.enrichment.coefficients import (
    RADIUS_CYCLE,
    Enriched,
    optimised_enrichment,
    optimised_placement,
)
from mesh_motion_server.numerics.enrichment.space import EnrichmentSpace


def space_of(name: str, count: int = 20) -> EnrichmentSpace:
    problem, trial = case(name), stored(CASES[name][0]).trial
    quality = trial.quality(problem.standard)
    placement = optimised_placement(problem.start, problem.cells, quality, count=count, radius=RADIUS)
    return EnrichmentSpace(placement, problem.factorization, problem.evaluator)


def enriched(name: str, count: int = 20, target: float = np.inf) -> Enriched:
    problem = case(name)
    trial = stored(CASES[name][0]).trial
    return optimised_enrichment(trial, problem.start, problem.standard, space_of(name, count), target=target)


@pytest.mark.parametrize("name", ["-0.2, -0.2, +60°", "3D box 0.25 + bend"])
def test_the_functions_vanish_on_the_boundary(name: str) -> None:
    problem, space = case(name), space_of(name)
    d = problem.start.shape[1]
    values = space.values(problem.start)
    assert values.shape == (len(problem.start), 2 * 20 * d)
    assert np.abs(values[problem.held]).max() < 1e-9 * np.abs(values).max()
    coefficients = np.random.default_rng(1).normal(size=(2 * 20 * d, d))
    np.testing.assert_allclose(
        space.displacement(problem.start, coefficients), values @ coefficients, atol=1e-9 * np.abs(values).max()
    )


def test_points_are_bad_cells_apart_from_each_other() -> None:
    problem, space = case("-0.2, -0.2, +60°"), space_of("-0.2, -0.2, +60°")
    quality = stored("correction_slab").trial.quality(problem.standard)
    assert space.placement.cells[0] == np.argmin(quality)
    assert quality[space.placement.cells].max() < 0.4
    assert len(set(space.placement.cells.tolist())) == 20
    np.testing.assert_allclose(space.placement.radii, np.resize(RADIUS_CYCLE, 20) * RADIUS)


def test_the_result_is_in_the_space_and_the_boundary_held() -> None:
    problem, space = case("-0.2, -0.2, +60°"), space_of("-0.2, -0.2, +60°")
    found = enriched("-0.2, -0.2, +60°")
    assert np.array_equal(found.points[problem.held], problem.standard[problem.held])
    change = (found.points - problem.standard)[~problem.held]
    psi = space.values(problem.start[~problem.held])
    fitted = psi @ np.linalg.lstsq(psi, change, rcond=None)[0]
    np.testing.assert_allclose(fitted, change, atol=1e-8)


def test_more_points_reach_more() -> None:
    minima = [enriched("dx -0.3", count).minimum for count in (5, 10, 20, 40)]
    assert minima == sorted(minima)
    assert minima[-1] > 0.32


def test_it_stops_at_the_target() -> None:
    found, best = enriched("dx -0.3", target=0.2), enriched("dx -0.3")
    assert 0.2 <= found.minimum < best.minimum
    assert found.iterations < best.iterations


@pytest.mark.parametrize("name", ["-0.2, -0.2, +60°", "3D box 0.25 + bend"])
def test_a_working_set_reaches_nearly_what_all_cells_do(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    everything = enriched(name)
    monkeypatch.setattr(module, "WORKING_CELLS", 600)
    found = enriched(name)
    problem = case(name)
    assert found.minimum == stored(CASES[name][0]).trial.quality(found.points).min()
    assert found.minimum > 0.85 * everything.minimum
    assert np.array_equal(found.points[problem.held], problem.standard[problem.held])


def test_a_singular_system_is_solved_with_the_smallest_ridge_that_helps() -> None:
    rng = np.random.default_rng(3)
    half = rng.normal(size=(6, 3))
    matrix, right = half @ half.T, rng.normal(size=6)  # of rank 3
    step = module._solve_scaled(matrix, matrix @ right)
    np.testing.assert_allclose(matrix @ step, matrix @ right, rtol=1e-6)
