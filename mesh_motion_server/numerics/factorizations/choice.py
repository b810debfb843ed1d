"""Which solver, by the number of control points and the nonzero entries of a row.

Measured on two cores, points on the surfaces of a box and a wing in it, three right-hand sides; N points, m entries a
row on average:

- dense: N³/3 operations, 4 N² bytes. N = 4 258: 0.6 s; 10 000: 6 s and 0.4 GB; 18 216: 30 s and 1.3 GB.
- sparse: N = 4 258, m = 300: 1.0 s, m = 60: 0.2 s, against the dense 1 s; N = 18 216, m = 250: 8.5 s, m = 90: 1.9 s.
- iterative, entries summed: a solution costs about 30 products, N = 4 258: 1 s, 18 216: 9 s; entries stored (m = 250):
  0.3 s after a set-up of 1 s.

A factorization serves all coupling iterations of a step and the enrichment's many columns, so a direct one is preferred
as long as it fits comfortably.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.assembly import dense_block, mean_row_entries, sparse_matrix
from mesh_motion_server.numerics.centres import CentreLayout, padded
from mesh_motion_server.numerics.factorizations import LinearSolver
from mesh_motion_server.numerics.factorizations.dense import PanelCholesky
from mesh_motion_server.numerics.factorizations.iterative import ConjugateGradients
from mesh_motion_server.numerics.factorizations.sparse import SparseFactor
from mesh_motion_server.numerics.kernels import Basis

__all__ = ["SOLVERS", "choose_solver"]

SOLVERS = ("auto", "dense", "sparse", "iterative")

#: Largest order for which "auto" makes a dense factor; a third of its set-up pays for one iterative solution there.
_DENSE_ORDER = 10_000
#: Entries a row up to which a sparse factorization beats the others, for more points than a dense one does in no time.
_SPARSE_ENTRIES, _SPARSE_ORDER = 150.0, 1_500


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
    name = _automatic(layout, support_radius) if solver == "auto" else solver
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


def _automatic(layout: CentreLayout, support_radius: float) -> str:
    """Name of the solver for these points."""
    n = layout.n_centres
    if n > _SPARSE_ORDER and not layout.is_direct and mean_row_entries(layout, support_radius) <= _SPARSE_ENTRIES:
        return "sparse"
    return "dense" if n <= _DENSE_ORDER else "iterative"
