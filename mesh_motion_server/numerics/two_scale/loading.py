"""The kernels of two scales loaded, or compiled where that was not done yet, before a motion needs them."""

from __future__ import annotations

import numpy as np

from mesh_motion_server.numerics.evaluation import LocalEvaluator
from mesh_motion_server.numerics.two_scale.factorization import TwoScalePlan

__all__ = ["load_two_scale_kernels"]


def load_two_scale_kernels() -> None:
    """Solve and evaluate once, with enough coarse points to sum by blocks, around a body small in its domain.

    A motion of a tiny mesh has neither, and so leaves kernels out.
    """
    points = np.random.default_rng(0).random((80, 3))
    points[:60] = 0.5 + 0.01 * (points[:60] - 0.5)
    plan = TwoScalePlan.build(points, points[:, 0] < 0.5, basis="wendland-c2", support_radius=2.5, count=60)
    found = plan.factorize(points, np.zeros(3), np.ones(3)).solve(points)
    LocalEvaluator().displacement(found, points)
    LocalEvaluator().gradient(found, points)
