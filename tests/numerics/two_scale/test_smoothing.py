"""The first level of a boundary damps a wave of the chosen length to a half, and leaves shorter waves to the others."""

import numpy as np
import pytest
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.kernels import MULTISCALE
from mesh_motion_numerics.interpolation.two_scale.factorization import TwoScaleFactorization, TwoScalePlan
from mesh_motion_numerics.interpolation.two_scale.smoothing import Smoothing


def wall(d: int, spacing: float) -> np.ndarray:
    """A straight wall of length 4 in a plane; in 3D of width 1.6, with half the spacing across."""
    x = np.arange(0.0, 4.0, spacing)
    if d == 2:
        return np.column_stack([x, 0.0 * x])
    x, z = (a.ravel() for a in np.meshgrid(x, np.arange(0.0, 1.6, spacing / 2.0)))
    return np.column_stack([x, 0.0 * x, z])


def smoothed(points: np.ndarray, wave: float, basis: str) -> TwoScaleFactorization:
    plan = TwoScalePlan.build(
        points,
        np.ones(len(points), dtype=bool),
        basis=basis,
        support_radius=2.0,
        gridded=False,
        smoothing=Smoothing(wave, 16.0),
    )
    return plan.factorize(points, points.min(axis=0), points.max(axis=0))


@pytest.mark.parametrize("basis", ["wendland-c2", MULTISCALE])
@pytest.mark.parametrize(("d", "spacing"), [(2, 0.01), (2, 0.03), (3, 0.08)])
def test_a_wave_is_damped_to_a_half_on_any_mesh_and_the_sum_is_exact(d: int, spacing: float, basis: str) -> None:
    points, wave = wall(d, spacing), 0.4
    prepared, share = smoothed(points, wave, basis), {}
    middle = (np.abs(points[:, 0] - 2.0) < 0.8) & (np.abs(points[:, -1] - (0.8 if d == 3 else 0.0)) < 0.4)
    for length in (2.0 * wave, wave, wave / 2.0):
        values = np.cos(2.0 * np.pi * points[:, :1] / length)
        found = prepared.solve(values)
        first = evaluation.displacement(prepared.coarse.solve(values[prepared.plan.coarse]), points)
        share[length] = np.sum((first * values)[middle]) / np.sum((values**2)[middle])
        assert np.abs(evaluation.displacement(found, points) - values).max() < 1e-9
    assert share[wave] == pytest.approx(0.5, abs=0.03)
    assert share[2.0 * wave] > 0.85
    assert share[wave / 2.0] < 0.1
