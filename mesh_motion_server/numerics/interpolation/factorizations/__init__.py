"""Solvers for the interpolation matrix ``φ(|x_i − x_j|/R)`` of distinct control points, one per module.

Each keeps the data to solve again for other displacements: the coupling iterations of a time step share one. A
*linear solver* gives weights; a *system* gives weights and, if there is a polynomial, its coefficients.
"""

from __future__ import annotations

from typing import Protocol

from numpy import float64
from numpy.typing import NDArray

__all__ = ["LinearSolver", "System"]


class LinearSolver(Protocol):
    """A factorized (or preconditioned) interpolation matrix."""

    @property
    def name(self) -> str:
        """``"dense"``, ``"sparse"`` or ``"iterative"``."""
        ...

    @property
    def nbytes(self) -> int:
        """Memory it holds."""
        ...

    def solve(self, values: NDArray[float64]) -> NDArray[float64]:
        """(nc, k) weights of (nc, k) values at the control points, in the caller's order."""
        ...


class System(Protocol):
    """The system of thesis (2.4), with or without a polynomial."""

    @property
    def name(self) -> str:
        """Name of its linear solver."""
        ...

    @property
    def nbytes(self) -> int:
        """Memory it holds."""
        ...

    def solve(self, values: NDArray[float64]) -> tuple[NDArray[float64], NDArray[float64] | None]:
        """(nc, k) weights and (d + 1, k) polynomial coefficients or None, of (nc, k) values."""
        ...
