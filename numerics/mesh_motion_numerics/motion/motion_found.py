"""The result of one motion of a mesh: positions, qualities, the result of the correction, and the cost."""

from dataclasses import dataclass

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.correction.correction import Correction
from mesh_motion_numerics.interpolation.factor_source import CacheReport
from mesh_motion_numerics.interpolation.two_scale.interpolant import AnyInterpolant
from mesh_motion_numerics.quality.quality_summary import Judgement

__all__ = ["Motion"]


@dataclass(frozen=True, eq=False)
class Motion:
    """An accepted motion; it is a trial until it is committed.

    Attributes
    ----------
    points : (n, d) array
        New positions, mesh length unit; the moving nodes are bitwise at their targets.
    standard, corrected : QualitySummary, or LowestQuality of a model without distributions
        Predicted before any node moved: by the standard motion, and after the correction.
    correction : Correction
        Result of the correction.
    reached : bool
        Whether ``corrected`` is at or above the threshold.
    seconds : dict
        Wall time of ``solve``, ``predict``, ``correct``, ``displace`` and their ``total``.
    caches : dict
        ``"reused"`` or ``"made"`` for each cached kind (``factorization``, ``operators``), all of which depend only on
        the state; ``bytes``: the cache's size for each kind; and entries that a model adds.
    control_points : (nc,) int64 array
        Nodes from which the standard motion was interpolated.
    support_radius : float
        R of the standard motion, mesh length unit.
    sub_steps : int
        Legs in which the mesh was led there; 1 for a direct motion.
    field : Interpolant or TwoScaleInterpolant, optional
        The displacement as a field, if the volume is in other processes: then the qualities are not known.
    """

    points: Floats
    standard: Judgement
    corrected: Judgement
    correction: Correction
    reached: bool
    seconds: dict[str, float]
    caches: CacheReport
    control_points: Integers
    support_radius: float
    warnings: list[str]
    sub_steps: int = 1
    field: AnyInterpolant | None = None
