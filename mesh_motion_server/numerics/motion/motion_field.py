"""The standard motion as a field, defined anywhere: a sequence of stages, each a rigid motion plus RBF sums."""

from __future__ import annotations

from dataclasses import dataclass, replace

from mesh_motion_server.numerics.arrays import Floats
from mesh_motion_server.numerics.interpolation.evaluation import Evaluator, Prepared, PreparingEvaluator
from mesh_motion_server.numerics.interpolation.interpolant import Interpolant
from mesh_motion_server.numerics.interpolation.two_scale.interpolant import AnyInterpolant
from mesh_motion_server.numerics.mesh.paths import RigidMotion

__all__ = ["MotionField", "Stage"]


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

    def with_largest(self, displacement: float) -> Stage:
        """The same stage for a largest ``displacement``: the levels share its tolerance."""
        levels = 1 + len(self.further)

        def scaled(level: AnyInterpolant) -> AnyInterpolant:
            return replace(level, largest=displacement / levels) if isinstance(level, Interpolant) else level

        return replace(
            self, interpolant=scaled(self.interpolant), further=tuple(scaled(level) for level in self.further)
        )

    def positions(self, points: Floats, evaluator: Evaluator, prepared: Prepared | None = None) -> Floats:
        """(n, d) new positions of points (n, d), with the evaluator's preparation for them."""
        carried = points if self.rigid is None else self.rigid.apply(points)
        if prepared is not None and isinstance(evaluator, PreparingEvaluator):
            moved = evaluator.displacement(self.interpolant, points, prepared)
        else:
            moved = evaluator.displacement(self.interpolant, points)
        for level in self.further:
            moved += evaluator.displacement(level, points)
        moved += carried
        return moved


@dataclass(frozen=True, eq=False)
class MotionField:
    """The displacement field of one or more stages."""

    stages: tuple[Stage, ...]
    evaluator: Evaluator

    def displacement(self, points: Floats) -> Floats:
        """(n, d) total displacement of points (n, d), mesh length unit."""
        moved = points
        for stage in self.stages:
            moved = stage.positions(moved, self.evaluator)
        return moved - points
