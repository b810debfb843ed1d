"""The standard motion as a field, defined anywhere: a sequence of stages, each a rigid motion plus RBF sums.

Through several stages the deformation gradients multiply, ``B = B_n … B_2 B_1`` with each ``B_i = R_i + ∇S_i`` taken
where the stages before have moved the point (thesis (3.9)–(3.12)).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.interpolation.evaluation import Evaluator, Prepared, PreparingEvaluator
from mesh_motion_server.numerics.interpolation.interpolant import Interpolant
from mesh_motion_server.numerics.interpolation.two_scale.interpolant import AnyInterpolant
from mesh_motion_server.numerics.mesh.paths import RigidMotion
from mesh_motion_server.numerics.reduction.volume_reduction import VolumeField

__all__ = ["MotionField", "Stage"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Stage:
    """``x → rigid(x) + S(x)``.

    Attributes
    ----------
    rigid : RigidMotion or None
        None is the identity.
    interpolant : Interpolant or TwoScaleInterpolant
        S, or its first level where few control points stand for the boundary.
    further : tuple of Interpolant
        Its other levels, to be added.
    volume : VolumeField or None
        What stands for S where the volume is reduced.
    """

    rigid: RigidMotion | None
    interpolant: AnyInterpolant
    further: tuple[AnyInterpolant, ...] = ()
    volume: VolumeField | None = None

    def with_largest(self, displacement: float) -> Stage:
        """The same with a largest ``displacement``, of whose tolerance each level takes its share."""
        levels = 1 + len(self.further)

        def scaled(level: AnyInterpolant) -> AnyInterpolant:
            return replace(level, largest=displacement / levels) if isinstance(level, Interpolant) else level

        return replace(
            self, interpolant=scaled(self.interpolant), further=tuple(scaled(level) for level in self.further)
        )

    def positions(self, points: Floats, evaluator: Evaluator, prepared: Prepared | None = None) -> Floats:
        """(n, d) where the stage puts points (n, d), with what the evaluator has prepared for them."""
        carried = points if self.rigid is None else self.rigid.apply(points)
        if self.volume is not None:
            return np.asarray(carried + self.volume(points).displacement)
        moved = self.interpolated(points, evaluator, prepared)
        moved += carried
        return moved

    def interpolated(self, points: Floats, evaluator: Evaluator, prepared: Prepared | None = None) -> Floats:
        """(n, d) sum of the levels at points (n, d), whatever a volume reduction makes of it."""
        if prepared is not None and isinstance(evaluator, PreparingEvaluator):
            total = evaluator.displacement(self.interpolant, points, prepared)
        else:
            total = evaluator.displacement(self.interpolant, points)
        for level in self.further:
            total += evaluator.displacement(level, points)
        return total

    def deformation(self, points: Floats, evaluator: Evaluator) -> Floats:
        """(n, d, d) deformation gradient B at points (n, d).

        Raises
        ------
        InvalidInput
            If the volume is reduced: only displacements are known then.
        """
        if self.volume is not None:
            raise InvalidInput(
                "a motion with a volume reduction has no gradient", hint="predictor = 'trial-nodes' needs none"
            )
        turn = np.eye(points.shape[1]) if self.rigid is None else self.rigid.rotation
        deformed = turn + evaluator.gradient(self.interpolant, points)
        for level in self.further:
            deformed += evaluator.gradient(level, points)
        return deformed


@dataclass(frozen=True, eq=False)
class MotionField:
    """The displacement field of one or more stages."""

    stages: tuple[Stage, ...]
    evaluator: Evaluator

    @property
    def single(self) -> tuple[Interpolant, RigidMotion | None] | None:
        """The interpolant and the rigid motion of a field that consists of nothing else; None for any other."""
        stage = self.stages[0]
        more = len(self.stages) > 1 or stage.further or stage.volume is not None
        return None if more or type(stage.interpolant) is not Interpolant else (stage.interpolant, stage.rigid)

    def displacement(self, points: Floats) -> Floats:
        """(n, d) total displacement of points (n, d), mesh length unit."""
        moved = points
        for stage in self.stages:
            moved = stage.positions(moved, self.evaluator)
        return moved - points

    def gradient(self, points: Floats) -> Floats:
        """(n, d, d) gradient of the total displacement, ``[:, i, j] = ∂S_i/∂x_j``."""
        identity = np.eye(points.shape[1])
        total, moved = np.broadcast_to(identity, (len(points), *identity.shape)), points
        for number, stage in enumerate(self.stages, start=1):
            total = np.einsum("nij,njk->nik", stage.deformation(moved, self.evaluator), total)
            if number < len(self.stages):
                moved = stage.positions(moved, self.evaluator)
        return np.asarray(total - identity)
