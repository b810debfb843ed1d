"""Which solver: by the number of control points and the share of entries that are not zero.

Measured on two cores, points on the surface of a box, three right-hand sides:

- dense: N³/3 operations at about 90 Gflop/s, 4 N² bytes. N = 5 900: 1 s and 0.14 GB; N = 12 000: 7 s and 0.6 GB.
- sparse, by SuperLU: two orders of magnitude slower an operation, so that it pays only while the factors stay sparse.
- iterative: nothing to factorize, memory ∝ N, but every solution costs 15–30 products with the matrix.

A factorization serves all coupling iterations and the enrichment's many columns, so a direct one is preferred as long
as it fits comfortably.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.assembly import dense_block, sparse_matrix
from mesh_motion_server.numerics.centres import CentreLayout, padded, pairs_fraction
from mesh_motion_server.numerics.factorizations import LinearSolver
from mesh_motion_server.numerics.factorizations.dense import PanelCholesky
from mesh_motion_server.numerics.factorizations.iterative import ConjugateGradients
from mesh_motion_server.numerics.factorizations.sparse import SparseFactor
from mesh_motion_server.numerics.kernels import Basis

__all__ = ["SOLVERS", "choose_solver"]

SOLVERS = ("auto", "dense", "sparse", "iterative")

#: Order up to which a dense factor is made without asking: 4 N² bytes are 0.4 GB.
_DENSE_ORDER = 10_000
#: A sparse factorization pays below this share of nonzeros.
_SPARSE_ORDER, _SPARSE_FRACTION = 1_500, 0.01


def choose_solver(
    solver: str, points: NDArray[np.float64], layout: CentreLayout, basis: Basis, support_radius: float
) -> LinearSolver:
    """Make the named linear solver of a positive definite basis, or with "auto" the one that fits.

    Raises
    ------
    InvalidInput
        If the solver is "sparse" and the basis has no compact support.
    NumericalError
        If the matrix is singular to working precision.
    """
    name = _automatic(layout, basis) if solver == "auto" else solver
    if name == "iterative":
        return ConjugateGradients(layout, basis, support_radius)
    if name == "sparse":
        if not basis.compact:
            raise InvalidInput(
                f"the basis {basis.name!r} has no compact support: its matrix is full", hint="solver = 'dense'"
            )
        return SparseFactor(sparse_matrix(layout, basis, support_radius), layout.order)
    rows = padded(points)
    return PanelCholesky(
        len(rows), lambda first, last: dense_block(basis, support_radius, rows[first:], rows[first:last])
    )


def _automatic(layout: CentreLayout, basis: Basis) -> str:
    """Name of the solver for these points."""
    n = layout.n_centres
    if basis.compact and n > _SPARSE_ORDER and not layout.is_direct and pairs_fraction(layout) < _SPARSE_FRACTION:
        return "sparse"
    return "dense" if n <= _DENSE_ORDER else "iterative"
