"""Velocities of time schemes: motions for which they are exact, and their order with steps of all sizes."""

import numpy as np
import pytest
from mesh_motion_numerics.motion.time_levels import STORED_ARRAYS, TimeLevel, level_after, scheme_velocity


def places(times, motion):
    return [np.array([[motion(t), 2.0 * motion(0.5 * t)]]) for t in times]


def velocities(scheme, times, motion):
    at, level, found = places(times, motion), TimeLevel(times[0]), []
    stored = scheme if scheme in STORED_ARRAYS else ""
    for before, after, time in zip(at, at[1:], times[1:], strict=False):
        found.append(scheme_velocity(scheme, after, before, level, time)[0, 0])
        level = level_after(stored, after, before, level, time)
        assert len(level.arrays) == STORED_ARRAYS[stored]
    return np.array(found)


def uneven(count):
    """Times from 1 to 2 whose steps differ by up to a factor of three, alike under refinement."""
    even = np.linspace(0.0, 1.0, count + 1)
    return 1.0 + even + 0.25 / np.pi * np.sin(4 * np.pi * even) / 2


@pytest.mark.parametrize("scheme", ["bdf1", "bdf2", "bossak"])
def test_a_constant_velocity_is_found(scheme):
    """With "bossak", after the influence of the start at rest has ended."""
    times = uneven(200 if scheme == "bossak" else 7)
    found = velocities(scheme, times, lambda t: 3.0 - 2.0 * t)
    np.testing.assert_allclose(found[-1], -2.0, rtol=1e-10)


def test_bdf2_is_exact_for_quadratic_motions_with_any_steps():
    times = np.array([0.5, 0.6, 1.0, 1.05, 3.0])
    found = velocities("bdf2", times, lambda t: 1.0 + t - 4.0 * t**2)
    np.testing.assert_allclose(found[1:], (1.0 - 8.0 * times[1:])[1:], rtol=1e-12)
    first = velocities("bdf1", times[:2], lambda t: 1.0 + t - 4.0 * t**2)
    assert found[0] == first[0]  # no position before the first one


@pytest.mark.parametrize(("scheme", "order"), [("bdf1", 1), ("bdf2", 2)])
def test_orders_with_uneven_steps(scheme, order):
    errors = []
    for count in (160, 320, 640):
        times = uneven(count)
        errors.append(np.abs(velocities(scheme, times, np.sin)[1:] - np.cos(times[2:])).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, order, atol=0.1)


def test_bossak_is_newmarks_rule_solved_for_the_velocity():
    """x = x₀ + Δt v₀ + Δt² ((½ - β) a₀ + β a) and v = v₀ + Δt ((1 - γ) a₀ + γ a) hold at each step."""
    gamma, beta = 0.8, 0.4225
    times = uneven(9)
    at, level = places(times, np.sin), TimeLevel(times[0])
    for before, after, time in zip(at, at[1:], times[1:], strict=False):
        dt = time - level.time
        v0, a0 = level.arrays or (np.zeros((1, 2)), np.zeros((1, 2)))
        level = level_after("bossak", after, before, level, time)
        v, a = level.arrays
        np.testing.assert_allclose(before + dt * v0 + dt**2 * ((0.5 - beta) * a0 + beta * a), after, rtol=1e-13)
        np.testing.assert_allclose(v0 + dt * ((1.0 - gamma) * a0 + gamma * a), v, rtol=1e-12, atol=1e-12)
