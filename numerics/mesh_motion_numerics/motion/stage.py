"""A stage of the standard motion, defined anywhere: a rigid motion plus RBF sums."""

from dataclasses import dataclass

import mesh_motion_kernels as kernels
import numpy as np

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.evaluation import NearOperators
from mesh_motion_numerics.interpolation.two_scale.interpolant import AnyInterpolant
from mesh_motion_numerics.mesh.paths import RigidMotion

__all__ = ["Stage"]


@dataclass(frozen=True, eq=False)
class Stage:
    """``x → rigid(x) + S(x)``.

    Attributes
    ----------
    rigid : RigidMotion or None
        None means the identity.
    interpolant : Interpolant or TwoScaleInterpolant
        S, or its first level if few control points represent the boundary.
    further : tuple of Interpolant
        The other levels of S; S is the sum of all levels.
    """

    rigid: RigidMotion | None
    interpolant: AnyInterpolant
    further: tuple[AnyInterpolant, ...] = ()

    def positions(self, points: Floats, prepared: NearOperators | None = None) -> Floats:
        """(n, d) new positions of points (n, d), with the result of :func:`.evaluation.prepare` for them."""
        carried = points if self.rigid is None else self.rigid.apply(points)
        moved = evaluation.displacement(self.interpolant, points, prepared)
        for level in self.further:
            moved += evaluation.displacement(level, points)
        kernels.add_values(np.ascontiguousarray(carried).reshape(-1), moved.reshape(-1))
        return moved
