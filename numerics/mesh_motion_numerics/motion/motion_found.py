"""One motion of a mesh: the requested displacement; the positions, qualities, correction and cost that result."""

from dataclasses import dataclass
from typing import NamedTuple

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.correction.correction import Correction
from mesh_motion_numerics.interpolation.two_scale.interpolant import AnyInterpolant
from mesh_motion_numerics.quality.quality_summary import Judgement


class BoundaryDisplacement(NamedTuple):
    """The requested motion: (k, d) start positions of the moving nodes, and their displacement (k, d) from there."""

    origin: Floats
    displacement: Floats

    def at(self, fraction: float) -> Floats:
        """(k, d) positions of the moving nodes after a fraction of the displacement."""
        return self.origin + fraction * self.displacement


@dataclass(frozen=True, eq=False)
class Motion:
    """An accepted motion; it is a trial until it is committed."""

    points: Floats  # (n, d). New positions, mesh length unit; the moving nodes are bitwise at their targets
    #: standard, corrected: QualitySummary, or LowestQuality of a model without distributions. Predicted before any node
    #: moved: by the standard motion, and after the correction
    standard: Judgement
    corrected: Judgement
    correction: Correction  # result of the correction
    reached: bool  # whether ``corrected`` is at or above the threshold
    seconds: dict[str, float]  # wall time of ``solve``, ``predict``, ``correct``, ``displace`` and their ``total``
    #: ``"reused"`` or ``"made"`` for each cached kind (``factorization``, ``operators``), all of which depend only on
    #: the state.
    caches: dict[str, str]
    control_points: Integers  # (nc,). Nodes from which the standard motion was interpolated
    support_radius: float  # r of the standard motion, mesh length unit
    warnings: list[str]
    sub_steps: int = 1  # legs in which the mesh was led there; 1 for a direct motion
    #: Interpolant or TwoScaleInterpolant, optional. The displacement as a field, if the volume is in other processes:
    #: then the qualities are not known.
    field: AnyInterpolant | None = None
