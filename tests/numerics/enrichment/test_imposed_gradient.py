"""Thesis chapter 4: Table 4.1 and Figures 4.15, 4.17–4.19, to the printed digits."""

import numpy as np
import pytest
from mesh_motion_numerics.correction.enrichment.imposed_gradient import (
    ImposedGradient,
    bracketing_slopes,
    solve_imposed_gradient,
)
from mesh_motion_protocol.errors import InvalidInput, QualityRefused

NODES = np.linspace(0, 1, 21)
CENTRES = (NODES[1:] + NODES[:-1]) / 2
NOWHERE = np.empty(0)


def contraction(left, right, d_left, d_right):
    return np.array([0.0, left, right, 1.0]), np.array([0.0, d_left, d_right, 0.0])


def predicted(interpolant):
    """Size at the cell centres, 1 + S′."""
    return 1 + interpolant.gradient(CENTRES)


def actual_minimum(interpolant):
    return float(np.min(np.diff(NODES + interpolant.displacement(NODES)) / np.diff(NODES)))


def worst_places(interpolant, threshold):
    """Cell centres that are local minima of the predicted size below a threshold, thesis (4.11)."""
    size = np.pad(predicted(interpolant), 1, constant_values=np.inf)
    minima = (size[1:-1] < threshold) & (size[1:-1] < size[:-2]) & (size[1:-1] <= size[2:])
    return CENTRES[minima]


@pytest.mark.parametrize(
    ("radius", "function", "minimum", "printed"),
    [
        (0.2, "H1", 0.26226, 0.262),
        (0.2, "H2", 0.09160, 0.091),
        (0.2, "H3", -0.00634, -0.006),
        (0.3, "H1", 0.37887, 0.379),
        (0.3, "H2", 0.28484, 0.284),
        (0.3, "H3", 0.24257, 0.242),
        (0.4, "H1", 0.34576, 0.346),
        (0.4, "H2", 0.32791, 0.328),
        (0.4, "H3", 0.32910, 0.329),
    ],
)
def test_table_4_1_enriched(radius, function, minimum, printed):
    settings = ImposedGradient(radius, 1.0, function=function)
    interpolant = solve_imposed_gradient(*contraction(0.2, 0.8, 0.15, -0.15), np.array([0.5]), settings)
    assert interpolant.gradient(np.array([0.5])) == pytest.approx(-0.5, abs=1e-13)
    assert actual_minimum(interpolant) == pytest.approx(minimum, abs=5e-6)
    assert actual_minimum(interpolant) == pytest.approx(printed, abs=1e-3)


@pytest.mark.parametrize(
    ("nodes", "slopes", "standard", "enriched"),
    [
        ((0.2, 0.8, 0.15, -0.15), (-0.5, -0.5), 0.227, 0.419),  # Fig 4.15
        ((0.2, 0.7, 0.12, -0.216), (-0.672, -0.672), -0.089, 0.160),  # Fig 4.17
        ((0.2, 0.8, 0.252, -0.06), (-0.52, -0.52), -0.299, 0.177),  # Fig 4.18
        ((0.45, 0.8, -0.156, 0.096), (-0.3466, -0.48), 0.215, 0.379),  # Fig 4.19
    ],
)
def test_local_corrections_at_the_worst_cells(nodes, slopes, standard, enriched):
    boundary, displacement = contraction(*nodes)
    settings = ImposedGradient(0.4, 0.4)
    plain = solve_imposed_gradient(boundary, displacement, NOWHERE, settings)
    assert actual_minimum(plain) == pytest.approx(standard, abs=6e-4)
    places = worst_places(plain, 0.9)
    assert len(places) == 2
    assert bracketing_slopes(boundary, displacement, places) == pytest.approx(slopes, abs=1e-4)
    corrected = solve_imposed_gradient(boundary, displacement, places, settings)
    assert actual_minimum(corrected) == pytest.approx(enriched, abs=6e-4)


def test_boundary_conditions_and_slopes_hold_exactly():
    boundary, displacement = contraction(0.2, 0.7, 0.12, -0.216)
    places = np.array([0.33, 0.61])
    interpolant = solve_imposed_gradient(boundary, displacement, places, ImposedGradient(0.4, 0.4))
    assert np.allclose(interpolant.displacement(boundary), displacement, rtol=0, atol=1e-15)
    assert np.allclose(interpolant.gradient(places), -0.672, rtol=0, atol=1e-14)


def test_gradient_is_the_derivative_of_the_displacement():
    boundary, displacement = contraction(0.2, 0.7, 0.12, -0.216)
    interpolant = solve_imposed_gradient(boundary, displacement, np.array([0.4]), ImposedGradient(0.4, 0.5))
    x, h = np.linspace(0.013, 0.97, 50), 1e-6
    difference = (interpolant.displacement(x + h) - interpolant.displacement(x - h)) / (2 * h)
    assert np.allclose(interpolant.gradient(x), difference, atol=1e-8)


def test_a_point_outside_is_named():
    boundary, displacement = contraction(0.2, 0.8, 0.15, -0.15)
    with pytest.raises(InvalidInput, match=r"enrichment point 1 at 1\.2 does not lie between two boundary nodes"):
        bracketing_slopes(boundary, displacement, np.array([0.5, 1.2]))


def test_two_points_in_one_place_are_refused():
    boundary, displacement = contraction(0.2, 0.8, 0.15, -0.15)
    with pytest.raises(QualityRefused, match="singular"):
        solve_imposed_gradient(boundary, displacement, np.array([0.5, 0.5]), ImposedGradient(0.3, 1.0))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (ImposedGradient(-1.0, 1.0), "support radius"),
        (ImposedGradient(1.0, 1.0, basis="wendland-c0"), "no gradient at a control point"),
        (ImposedGradient(1.0, 1.0, basis="tps"), "no polynomial term"),
    ],
)
def test_unusable_settings(settings, message):
    boundary, displacement = contraction(0.2, 0.8, 0.15, -0.15)
    with pytest.raises(InvalidInput, match=message):
        solve_imposed_gradient(boundary, displacement, np.array([0.5]), settings)
