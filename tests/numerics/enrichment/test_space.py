"""The functions of an enrichment space: zero at the boundary, and their gradients compared with differences."""

import numpy as np
import pytest
from correction_cases import case
from mesh_motion_numerics.correction.enrichment.placement import Placement
from mesh_motion_numerics.correction.enrichment.space import EnrichmentSpace

NAMES = ["dx -0.3", "3D box 0.25 + bend"]


def space_of(name: str, kinds: tuple[str, ...]) -> EnrichmentSpace:
    problem = case(name)
    cells = np.array([3, 50, 120])
    placement = Placement(cells, problem.cells.centres(problem.start, cells), np.array([0.3, 0.5, 0.9]))
    return EnrichmentSpace(placement, problem.factorization, kinds)


@pytest.mark.parametrize("kinds", [("H1",), ("H2",), ("H3",), ("H1", "H3")], ids=str)
@pytest.mark.parametrize("name", NAMES)
def test_nothing_moves_on_the_boundary_and_gradients_are_derivatives(name: str, kinds: tuple[str, ...]) -> None:
    space, problem = space_of(name, kinds), case(name)
    d = problem.start.shape[1]
    assert space.size == 3 * d * len(kinds)
    at_boundary = space.values(problem.start[problem.held])
    assert np.abs(at_boundary).max() < 1e-9 * np.abs(space.values(problem.start)).max()
    places, h = np.random.default_rng(1).uniform(0.1, 0.3, (20, d)), 1e-6
    numeric = np.stack([(space.values(places + h * e) - space.values(places - h * e)) / (2 * h) for e in np.eye(d)], 2)
    found = space.gradients(places)
    assert found.shape == (20, space.size, d)
    np.testing.assert_allclose(found, numeric, atol=1e-6 * np.abs(found).max())


@pytest.mark.parametrize("name", NAMES)
def test_displacement_is_linear_in_the_coefficients(name: str) -> None:
    space, problem = space_of(name, ("H1",)), case(name)
    coefficients = np.random.default_rng(2).normal(size=(space.size, 2))
    np.testing.assert_allclose(
        space.displacement(problem.start, coefficients), space.values(problem.start) @ coefficients, atol=1e-9
    )
