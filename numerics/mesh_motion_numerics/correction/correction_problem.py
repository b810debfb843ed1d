"""The input of a correction: a predicted motion, the name of the correction, and the quality to reach."""

from dataclasses import dataclass

import numpy as np

from mesh_motion_numerics.arrays import Floats, Marks
from mesh_motion_numerics.correction.boundary_constraint import BoundaryConstraint
from mesh_motion_numerics.correction.part_of_mesh import Elsewhere
from mesh_motion_numerics.interpolation.interpolant import Factorization
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.quality.metrics import AtRest

SMALL_MESH = {1: 1_000_000, 2: 30_000, 3: 5_000}
"""Free nodes, by dimension, up to which a correction without a target goes for the maximum: a second or two there."""

_VALID = 1e-6


@dataclass(frozen=True, eq=False)
class CorrectionProblem:
    """A predicted motion."""

    start: Floats  # (n, d), mesh length unit. Positions from which the standard motion starts
    standard: Floats  # (n, d), mesh length unit. Node positions of the standard motion
    held: Marks  # (n,). Nodes that no correction may move
    cells: CellTable
    reference_sizes: AtRest  # (m,), length^d, or CellsAtRest
    factorization: Factorization  # The factorization of the boundary at ``start``
    #: (n, d), mesh length unit. Nodes of the reference mesh, the ideal shape of cells that are not simplices; ``start``
    #: by default.
    reference: Floats | None = None
    #: Held nodes that ``optimised`` may move: along their surface, or in pairs.
    constraint: BoundaryConstraint | None = None
    #: (n, d), mesh length unit. A valid mesh with the held nodes of ``standard``, if one is known: ``optimised`` begins
    #: from it instead of untangling ``standard``, and the other corrections do not change it.
    valid: Floats | None = None
    known: float | None = None  # Smallest quality of ``standard``, if it was already judged and no cell is inverted
    elsewhere: Elsewhere | None = None  # The rest of the mesh, if this is a region of it; for target "threshold" only

    @property
    def begin(self) -> Floats:
        """Start positions (n, d) of the correction."""
        return self.standard if self.valid is None else self.valid


def target_quality(problem: CorrectionProblem, method: Method) -> float:
    """The quality at which a correction stops; inf for the best possible."""
    free = int(np.count_nonzero(~problem.held))
    small = free <= SMALL_MESH[problem.start.shape[1]]
    maximum = method.correction_target == "maximum" or (method.correction_target is None and small)
    return float("inf") if maximum else goal(method)


def goal(method: Method) -> float:
    """The threshold; or only a valid mesh if the threshold would accept inverted cells."""
    return max(method.quality_threshold, _VALID)
