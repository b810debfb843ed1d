"""Imposed Jacobians: the coupled system (5.6), its elimination, and the result of the rounds."""

from dataclasses import replace

import numpy as np
import pytest
from box_meshes import box_mesh
from correction_cases import CASES, RADIUS, case, stored
from mesh_motion_numerics.correction.enrichment import functions
from mesh_motion_numerics.correction.enrichment.imposed_gradient import ImposedGradient, solve_imposed_gradient
from mesh_motion_numerics.correction.enrichment.imposed_jacobian import (
    ImposedJacobians,
    ImposedSettings,
    cell_gradients,
    impose,
    imposed_jacobians,
)
from mesh_motion_numerics.correction.enrichment.placement import Placement
from mesh_motion_numerics.correction.enrichment.space import EnrichmentSpace
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.interpolation.kernels import basis_named, slopes, values

from docs.studies.thesis._cell_corrections import CELL_CORRECTIONS


def space_at(points: np.ndarray, factorization, kind: str = "H1", radius: float = RADIUS) -> EnrichmentSpace:
    placement = Placement(np.arange(len(points)), points, np.full(len(points), radius))
    return EnrichmentSpace(placement, factorization, (kind,))


def run(name: str, **choices) -> ImposedJacobians:
    problem = case(name)
    mesh = stored(CASES[name][0]).trial
    return imposed_jacobians(problem, mesh, ImposedSettings(**{"enrichment_radius": RADIUS, **choices}))


@pytest.mark.parametrize("kind", ["H1", "H2", "H3"])
def test_in_1d_it_is_the_thesis_chapter_4(kind: str) -> None:
    boundary, displacement = np.array([0.0, 0.2, 0.7, 1.0]), np.array([0.0, 0.12, -0.216, 0.0])
    points = np.array([0.33, 0.61])
    thesis = solve_imposed_gradient(boundary, displacement, points, ImposedGradient(0.4, 0.5, function=kind))
    factor = factorize(boundary[:, None], support_radius=0.4)
    standard, space = factor.solve(displacement[:, None]), space_at(points[:, None], factor, kind)
    change = -0.672 - evaluation.gradient(standard, points[:, None])
    coefficients = impose(space.gradients(points[:, None]), change)
    x = np.linspace(0, 1, 21)[:, None]
    found = evaluation.displacement(standard, x) + space.displacement(x, coefficients)
    np.testing.assert_allclose(found[:, 0], thesis.displacement(x[:, 0]), atol=1e-13)


@pytest.mark.parametrize("kind", ["H1", "H2", "H3"])
@pytest.mark.parametrize("name", ["dx -0.3", "3D box 0.25 + bend"])
def test_elimination_solves_the_printed_system(name: str, kind: str) -> None:
    """(5.6) as it stands: boundary displacements and all Jacobians in one dense matrix."""
    problem = case(name)
    d, b = problem.start.shape[1], problem.factorization.control_points
    points = problem.cells.centres(problem.start, np.array([3, 50]))
    displacement = (problem.standard - problem.start)[problem.held]
    imposed = np.random.default_rng(1).normal(size=(2, d, d))
    basis = basis_named("wendland-c2")
    rho = points[:, None] - b
    r = np.linalg.norm(rho, axis=2)
    phi_b = values(basis, np.linalg.norm(b[:, None] - b, axis=2) / RADIUS)
    h_b = np.hstack([functions.values(kind, b, c, RADIUS) for c in points])
    phi_c = (slopes(basis, r / RADIUS)[..., None] * rho / RADIUS**2).transpose(0, 2, 1).reshape(-1, len(b))
    h_c = np.concatenate([functions.gradients(kind, points, c, RADIUS) for c in points], axis=1)
    matrix = np.block([[phi_b, h_b], [phi_c, h_c.transpose(0, 2, 1).reshape(2 * d, -1)]])
    solution = np.linalg.solve(matrix, np.vstack([displacement, imposed.transpose(0, 2, 1).reshape(-1, d)]))

    standard = problem.factorization.solve(displacement)
    space = space_at(points, problem.factorization, kind)
    change = imposed - evaluation.gradient(standard, points)
    coefficients = impose(space.gradients(points), change)
    np.testing.assert_allclose(coefficients, solution[len(b) :], rtol=1e-6, atol=1e-8 * np.abs(solution).max())


@pytest.mark.parametrize("name", ["dx -0.3", "3D box 0.25 + bend"])
def test_a_cell_gets_what_is_imposed_on_it(name: str) -> None:
    problem, numbers = case(name), np.array([7, 90])
    points = problem.cells.centres(problem.start, numbers)
    psi = space_at(points, problem.factorization).values(problem.start)
    change = np.random.default_rng(2).normal(size=(2, problem.start.shape[1], problem.start.shape[1]))
    coefficients = impose(cell_gradients(problem.start, psi, problem.cells, numbers), change)
    moved_by = cell_gradients(problem.start, psi @ coefficients, problem.cells, numbers)
    np.testing.assert_allclose(moved_by, change, atol=1e-8)


def test_gradients_of_cells_are_exact_for_linear_values() -> None:
    for kind in ("quad", "tetra", "hexahedron + wedge"):
        mesh = box_mesh(kind)
        slope = np.random.default_rng(3).normal(size=(4, mesh.points.shape[1]))
        found = cell_gradients(mesh.points, mesh.points @ slope.T + 1.0, mesh.cells, np.array([0, len(mesh.cells) - 1]))
        np.testing.assert_allclose(found, np.broadcast_to(slope, found.shape), atol=1e-12)


@pytest.mark.parametrize(
    ("name", "least"),
    [("dx -0.3", 0.15), ("dx dy -0.25", 0.15), ("-0.2, -0.2, +60°", 0.2), ("3D box 0.25 + bend", 0.15)],
)
@pytest.mark.parametrize("decomposition", ["eigen", "polar"])
def test_named_cases_become_valid_and_good(name: str, least: float, decomposition: str) -> None:
    problem, found = case(name), run(name, correct_cell=CELL_CORRECTIONS[decomposition])
    assert max(found.minima) == stored(CASES[name][0]).trial.quality(found.points).min() >= least
    assert np.array_equal(found.points[problem.held], problem.standard[problem.held])
    assert 0 < len(found.enrichment_points) <= 20
    apart = np.linalg.norm(found.enrichment_points[:, None] - found.enrichment_points, axis=2)
    assert apart[np.triu_indices(len(apart), 1)].min() > 0.1 * RADIUS


def test_it_stops_at_the_threshold_and_keeps_the_best_round() -> None:
    found = run("-0.2, -0.2, +60°", threshold=0.1)
    assert found.minima[-1] >= 0.1 > max(found.minima[:-1])
    found = run("dx -0.3", threshold=0.9, max_rounds=6)
    assert len(found.minima) == 7


def test_functions_differ_only_in_shape() -> None:
    reached = {kind: max(run("dx -0.3", function=kind).minima) for kind in ("H1", "H2", "H3")}
    assert reached["H1"] == max(reached.values())
    assert min(reached.values()) > -0.2  # the standard motion: -0.223


def test_no_points_are_no_change() -> None:
    problem = case("dx -0.3")
    assert run("dx -0.3", max_points=0).points is problem.standard
    broken = problem.standard.copy()
    broken[np.flatnonzero(~problem.held)[0]] = np.nan
    settings = ImposedSettings(enrichment_radius=RADIUS)
    found = imposed_jacobians(replace(problem, standard=broken), stored("thesis_block").trial, settings)
    assert len(found.minima) == 1
