"""Solvers for the interpolation matrix ``φ(|x_i − x_j|/R)`` of distinct control points, one per module.

Each solver keeps its data to solve again for other displacements: the coupling iterations of a time step share one
solver. A *linear solver* gives weights; :class:`.conditional.NullSpaceCholesky` gives weights and the polynomial of its
basis.
"""

from typing import Protocol

from mesh_motion_numerics.arrays import Floats

__all__ = ["LinearSolver"]


class LinearSolver(Protocol):
    """A factorized (or preconditioned) interpolation matrix."""

    @property
    def name(self) -> str:
        """``"dense"``, ``"sparse"`` or ``"iterative"``."""
        ...

    def solve(self, values: Floats) -> Floats:
        """(nc, k) weights of (nc, k) values at the control points, in the caller's order."""
        ...
