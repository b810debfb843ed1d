"""The functions ψ of some enrichment points: enrichment functions that do not move the boundary.

With H_m the enrichment functions and φ_bb the boundary's interpolation matrix, ::

    ψ_m(x) = H_m(x) − φ(x, b) φ_bb⁻¹ H_m(b)

vanishes on the boundary nodes: it is (5.16) of the thesis written as a function, or (4.2) and (5.6) after elimination
of the boundary's rows. A motion plus these functions keeps its boundary condition for any coefficients.
"""

from dataclasses import dataclass

import numpy as np

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.correction.enrichment import functions
from mesh_motion_numerics.correction.enrichment.placement import Placement
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import Factorization

FUNCTIONS = ("H1", "H2")
"""Every point has both kinds: with H1 alone, 20 points reach 0.60 to 0.85 of the ceiling, with both 0.80 to 0.94."""


@dataclass(frozen=True, eq=False)
class EnrichmentSpace:
    """The functions ψ of some enrichment points, evaluated anywhere."""

    placement: Placement  # The K points and their radii
    factorization: Factorization  # The factorization of the boundary
    kinds: tuple[str, ...] = FUNCTIONS  # Enrichment functions at every point

    @property
    def size(self) -> int:
        """s, the number of functions: d for every kind and point."""
        return len(self.kinds) * self.placement.points.size

    def values(self, points: Floats) -> Floats:
        """(n, s) values ψ at points (n, d)."""
        return self.displacement(points, np.eye(self.size))

    def displacement(self, points: Floats, coefficients: Floats) -> Floats:
        """(n, k) displacement ψ C at points (n, d), for coefficients (s, k)."""
        at_boundary = self._own(self.factorization.control_points) @ coefficients
        compensation = evaluation.displacement(self.factorization.solve(-at_boundary), points)
        return np.asarray(self._own(points) @ coefficients + compensation)

    def gradients(self, points: Floats) -> Floats:
        """(n, s, d) gradients ∇ψ at points (n, d)."""
        own = [functions.gradients(kind, points, centre, radius) for centre, radius, kind in self._each()]
        compensation = self.factorization.solve(-self._own(self.factorization.control_points))
        return np.asarray(np.concatenate(own, axis=1) + evaluation.gradient(compensation, points))

    def _own(self, points: Floats) -> Floats:
        """(n, s) values of the enrichment functions H at points (n, d)."""
        return np.hstack([functions.values(kind, points, centre, radius) for centre, radius, kind in self._each()])

    def _each(self) -> list[tuple[Floats, float, str]]:
        """Yield point, radius and kind of every d functions, in order."""
        pairs = zip(self.placement.points, self.placement.radii, strict=True)
        return [(centre, float(radius), kind) for centre, radius in pairs for kind in self.kinds]
