"""Interpolation of all control nodes in one scale by a named solver: the reference for the two-scale solver."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from mesh_motion_numerics.interpolation.factor_source import FactorSource
from mesh_motion_numerics.interpolation.interpolant import Factorization, factorize
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.motion.standard_motion import StandardMotion
from numpy.typing import NDArray

__all__ = ["in_one_scale"]


@dataclass(frozen=True, eq=False)
class _OneScale(StandardMotion):
    """The standard motion with a given solver for its control nodes."""

    solver: str = "iterative"

    def _all_factorized(
        self,
        points: NDArray[np.float64],
        origin: NDArray[np.float64],
        controls: NDArray[np.int64],
        factors: FactorSource,
    ) -> Factorization:
        del points, controls, factors
        basis, radius = self.method.basis, self.method.support_radius
        return factorize(origin, basis=basis, support_radius=radius, solver=self.solver)


def in_one_scale(model: MotionModel, solver: str = "iterative") -> MotionModel:
    """The model with all control nodes in one scale."""
    motion = model.standard_motion
    parts = {field.name: getattr(motion, field.name) for field in fields(motion)}
    return replace(model, standard_motion=_OneScale(**parts, solver=solver))
