"""The linear polynomial of an interpolation, thesis (2.3), (2.4): p(x) = β₀ + Σ_m β_m (x − c)_m / s.

Coordinates are relative to the control points' centre c, in units of their extent s, so that the columns of P have the
same magnitude wherever the mesh lies; the result is the same polynomial.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_numerics.arrays import Floats


@dataclass(frozen=True, eq=False)
class LinearBasis:
    """The monomials 1, (x − centre)/scale."""

    centre: Floats  # (d,), mesh length unit
    scale: float  # mesh length unit

    @classmethod
    def around(cls, points: Floats) -> LinearBasis:
        """Centred at the middle of the bounding box of (n, d) points.

        Raises InvalidInput if the points do not determine a linear polynomial: fewer than d + 1, or all on a line or
        plane.
        """
        low, high = points.min(axis=0), points.max(axis=0)
        basis = cls((low + high) / 2.0, max(float(np.max(high - low)) / 2.0, np.finfo(float).tiny))
        rank = np.linalg.matrix_rank(basis.matrix(points), tol=1e-10 * np.sqrt(len(points)))
        d = points.shape[1]
        if rank < d + 1:
            raise InvalidInput(
                f"the control points do not determine a linear polynomial: they span {rank - 1} of {d} dimensions",
                hint="use a compact basis without a polynomial, or add control points off their line or plane",
            )
        return basis

    def matrix(self, points: Floats) -> Floats:
        """(n, d + 1) matrix P of (n, d) points."""
        return np.column_stack([np.ones(len(points)), (points - self.centre) / self.scale])


@dataclass(frozen=True, eq=False)
class Polynomial:
    """A linear polynomial for each of k components."""

    basis: LinearBasis
    coefficients: Floats  # (d + 1, k)

    def __call__(self, points: Floats) -> Floats:
        """(n, k) values at (n, d) points."""
        scaled = (points - self.basis.centre) / self.basis.scale
        out = np.tile(self.coefficients[0], (len(points), 1))
        for m, row in enumerate(self.coefficients[1:]):  # term by term: a matrix product's sums depend on its blocking
            out += scaled[:, m, None] * row
        return out

    @property
    def gradient(self) -> Floats:
        """(k, d) constant gradient."""
        return self.coefficients[1:].T / self.basis.scale
