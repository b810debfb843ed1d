"""The bounds of the derivatives of the basis functions, against Taylor coefficients from Cauchy's integral."""

import numpy as np
import pytest

from mesh_motion_server.numerics.interpolation.far_field import derivative_bounds as module
from mesh_motion_server.numerics.interpolation.far_field.derivative_bounds import (
    ORDERS,
    derivative_bounds,
    lebesgue_constant,
)
from mesh_motion_server.numerics.interpolation.kernels import BASES, values

USABLE = sorted(name for name, basis in BASES.items() if not basis.unusable)


def continued(name, squared):
    """φ as an analytic function of ξ², for complex ones."""
    xi = np.sqrt(squared)
    if name in module._QUADRICS:
        return (1.0 + squared) ** (module._QUADRICS[name] / 2)
    if name == "gauss":
        return np.exp(-squared)
    power, factor = module._LOGARITHMS.get(name, (0, 0.0))
    return module._POWERS[name](xi) + factor * xi**power * np.log(xi)


def taylor(name, distance, cosine, order):
    """∂^p φ/p! along a line from a distance, at an angle to the centre."""
    t = 0.5 * distance * np.exp(2j * np.pi * np.arange(128) / 128)
    turned = continued(name, distance**2 + 2 * distance * cosine * t + t**2)
    return abs(np.mean(turned * (0.5 * distance / t) ** order)) / (0.5 * distance) ** order


@pytest.mark.parametrize("name", USABLE)
def test_the_powers_are_the_functions_of_the_table(name):
    xi = np.linspace(1e-3, 1.0, 50)
    np.testing.assert_allclose(continued(name, xi**2), values(BASES[name], xi), rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", USABLE)
def test_no_derivative_exceeds_its_bound_and_some_come_near(name):
    bounds = derivative_bounds(BASES[name], 4.0)
    shares = []
    for order in ORDERS:
        for distance in (0.2, 0.4, 0.9) if BASES[name].compact else (0.3, 1.0, 3.0):
            column = np.searchsorted(bounds.distances, distance, side="right")
            largest = max(taylor(name, distance, cosine, order) for cosine in np.linspace(-1.0, 1.0, 41))
            shares.append(largest / bounds.table[order, column])
    assert max(shares) <= 1.0
    assert max(shares) > 0.3


@pytest.mark.parametrize("name", USABLE)
def test_bounds_fall_with_the_distance(name):
    table = derivative_bounds(BASES[name], 4.0).table
    assert (table[ORDERS[0] :, 1:] <= table[ORDERS[0] :, :-1]).all()


@pytest.mark.parametrize("name", sorted(module._ZEROS))
def test_compact_functions_end_as_smoothly_as_stated(name):
    zero = module._ZEROS[name]
    near, nearer = values(BASES[name], [1 - 2e-2, 1 - 1e-2])
    assert near / nearer == pytest.approx(2.0**zero, rel=0.25)
    assert derivative_bounds(BASES[name], 2.0).across == zero
    assert derivative_bounds(BASES[name], 2.0).reach == 1.0


@pytest.mark.parametrize("order", ORDERS)
def test_lebesgue_constants_are_the_largest_sums_of_lagrange_functions(order):
    nodes = np.cos((2 * np.arange(order) + 1) * np.pi / (2 * order))
    u = np.linspace(-1, 1, 4001)
    total = np.zeros_like(u)
    for i in range(order):
        others = np.delete(nodes, i)
        total += np.abs(np.prod((u[:, None] - others) / (nodes[i] - others), axis=1))
    assert total.max() == pytest.approx(lebesgue_constant(order), rel=1e-6)
