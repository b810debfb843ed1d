"""A stage of the standard motion, defined anywhere: a rigid motion plus RBF sums."""

from dataclasses import dataclass

from mesh_motion_server.numerics.arrays import Floats
from mesh_motion_server.numerics.interpolation.evaluation import Evaluator, Prepared, PreparingEvaluator
from mesh_motion_server.numerics.interpolation.two_scale.interpolant import AnyInterpolant
from mesh_motion_server.numerics.mesh.paths import RigidMotion

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
