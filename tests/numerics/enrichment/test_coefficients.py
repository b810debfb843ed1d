"""Optimised enrichment: its space, and the quality that it reaches."""

import numpy as np
import pytest
from correction_cases import CASES, RADIUS, case, stored
from mesh_motion_numerics.correction.distortion import PNorm, corner_blocks, distortion_gradient, mean_distortion
from mesh_motion_numerics.correction.enrichment import coefficients as module
from mesh_motion_numerics.correction.enrichment.coefficients import (
    RADIUS_CYCLE,
    optimised_enrichment,
    optimised_placement,
)
from mesh_motion_numerics.correction.enrichment.space import EnrichmentSpace
from mesh_motion_numerics.correction.free_region import gathered
from mesh_motion_numerics.correction.trial_nodes import Polished
from scipy.sparse import bsr_matrix


def space_of(name: str, count: int = 20) -> EnrichmentSpace:
    problem, trial = case(name), stored(CASES[name][0]).trial
    quality = trial.quality(problem.standard)
    placement = optimised_placement(problem.start, problem.cells, quality, count=count, radius=RADIUS)
    return EnrichmentSpace(placement, problem.factorization)


def enriched(name: str, count: int = 20, target: float = np.inf) -> Polished:
    problem = case(name)
    trial = stored(CASES[name][0]).trial
    return optimised_enrichment(trial, problem.start, problem.standard, space_of(name, count), target=target)


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


@pytest.mark.nightly
def test_more_points_reach_more() -> None:
    minima = [enriched("dx -0.3", count).minimum for count in (5, 10, 20, 40)]
    assert minima == sorted(minima)
    assert minima[-1] > 0.32


def test_it_stops_at_the_target() -> None:
    found, best = enriched("dx -0.3", target=0.2), enriched("dx -0.3")
    assert 0.2 <= found.minimum < best.minimum
    assert found.iterations < best.iterations


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["-0.2, -0.2, +60°", "3D box 0.25 + bend"])
def test_a_working_set_reaches_nearly_what_all_cells_do(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    everything = enriched(name)
    monkeypatch.setattr(module, "WHOLE_CELLS", 600)
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
    step = module._solve_scaled(matrix.copy(), matrix @ right)
    np.testing.assert_allclose(matrix @ step, matrix @ right, rtol=1e-4)


@pytest.mark.parametrize("name", ["-0.2, -0.2, +60°", "3D box 0.25 + bend"])
def test_a_step_is_the_minimiser_of_the_model_within_the_space(name: str) -> None:
    """Compared with the dense normal equations in double precision, and the gradient with differences."""
    problem, mesh = case(name), stored(CASES[name][0]).trial
    region = mesh.free(~mesh.held)
    d, norm = problem.start.shape[1], PNorm(8, 2)
    psi = space_of(name, 5).values(problem.start[region.free])
    points = problem.start[region.nodes]
    _, weights = mean_distortion(points, region.simplices, norm)
    gradient = gathered(region.adjacency, distortion_gradient(points, region.simplices, weights, norm))
    blocks = np.zeros((len(region.simplices), d * d, d * d), dtype=np.float32)
    corner_blocks(points, region.simplices, weights, norm, blocks)
    hessian = region.adjacency.assemble(blocks, d)
    step = module._SpaceSteps(psi)(region.adjacency, hessian, -gradient)

    full = bsr_matrix((hessian, region.adjacency.columns, region.adjacency.row_starts)).toarray()
    basis = np.kron(np.linalg.qr(psi)[0], np.eye(d))
    exact = basis @ np.linalg.solve(basis.T @ full @ basis, -basis.T @ gradient.ravel())
    np.testing.assert_allclose(step.ravel(), exact, atol=2e-3 * np.abs(exact).max())

    coefficients = np.random.default_rng(4).normal(size=(psi.shape[1], d))
    direction = np.zeros_like(points)
    direction[: region.n_free] = psi @ coefficients
    direction /= np.abs(direction).max()
    h = 1e-6
    ahead, behind = (mean_distortion(points + sign * h * direction, region.simplices, norm)[0] for sign in (1, -1))
    assert np.vdot(gradient, direction[: region.n_free]) == pytest.approx((ahead - behind) / (2 * h), rel=1e-6)
