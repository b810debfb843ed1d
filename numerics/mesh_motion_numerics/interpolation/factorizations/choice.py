"""The choice of the solver, by the number of control points and the nonzero entries per row.

Seconds on one core for the set-up and for each solution with three right-hand sides, points on the surfaces of a box
and of a wing in it, N points and on average m entries per row; two cores need a little more than half of it:

====== ==== ============== ============= =============
N      m    dense          sparse        iterative
====== ==== ============== ============= =============
4 258  all  1.0 + 0.03                   0.5 + 0.6
4 258  300                 0.41 + 0.006  0.07 + 0.14
4 258  60                  0.09 + 0.003  0.07 + 0.06
10 160 all  9.2 + 0.15                   0.8 + 3.2
18 216 all  48 + 0.55                    1.2 + 11
18 216 250                 4.5 + 0.05    0.30 + 0.67
18 216 90                  1.5 + 0.03    0.28 + 0.25
====== ==== ============== ============= =============

A dense factor takes 4 N² bytes (10 160 points: 0.4 GB, 18 216: 1.3 GB). A factorization serves all coupling iterations
of a step and the enrichment's many columns, so a direct solver is preferred if it is small enough. A factorization
larger than :data:`~.memory_bound.FACTOR_BYTES` is refused.
"""

import numpy as np
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.interpolation.assembly import dense_block, mean_row_entries, sparse_matrix
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.factorizations import LinearSolver
from mesh_motion_numerics.interpolation.factorizations.dense import PanelCholesky
from mesh_motion_numerics.interpolation.factorizations.iterative import ConjugateGradients
from mesh_motion_numerics.interpolation.factorizations.memory_bound import check_dense, check_sparse
from mesh_motion_numerics.interpolation.factorizations.sparse import SparseFactor
from mesh_motion_numerics.interpolation.kernels import Basis
from mesh_motion_numerics.mesh.points import padded

#: Largest order for which "auto" makes a dense factor: there it costs as much as three iterative solutions.
_DENSE_ORDER = 10_000
#: Smallest order for which another solver is useful; below it the dense solver takes almost no time.
_SPARSE_ORDER = 1_500
#: Longest rows and most entries for which a sparse factor is made; :mod:`~.memory_bound` gives its memory.
_SPARSE_ROW, _SPARSE_ENTRIES = 300.0, 3e6


def choose_solver(
    solver: str, points: Floats, layout: CentreLayout, basis: Basis, support_radius: float
) -> LinearSolver:
    """Make the named linear solver of a positive definite basis; "auto" chooses one.

    Raises InvalidInput if the solver is "sparse" and the basis has no compact support. Raises QualityRefused if the
    matrix is singular to working precision. Raises ResourceExhausted if the factors of the named solver would take too
    much memory; "auto" chooses another one.
    """
    name = _automatic(layout, support_radius) if solver == "auto" else solver
    if name == "iterative":
        return ConjugateGradients(layout, basis, support_radius)
    if name == "sparse":
        if not basis.compact:
            raise InvalidInput(
                f"the basis {basis.name!r} has no compact support: its matrix is full", hint="solver = 'dense'"
            )
        check_sparse(layout.n_centres, _mean_row(layout, support_radius))
        return SparseFactor(sparse_matrix(layout, basis, support_radius), layout.order)
    return dense_solver(points, basis, support_radius)


def dense_solver(points: Floats, basis: Basis, support_radius: float, smoothing: Floats | None = None) -> PanelCholesky:
    """The factor of a dense matrix with λ, the ``smoothing`` (nc,), added to its diagonal.

    Raises QualityRefused if the matrix is singular to working precision. Raises ResourceExhausted if the factor would
    take too much memory.
    """
    check_dense(len(points))
    rows = padded(points)

    def panel(first: int, last: int) -> Floats:
        block = dense_block(basis, support_radius, rows[first:], rows[first:last])
        if smoothing is not None:
            np.einsum("ii->i", block[: last - first])[:] += smoothing[first:last]
        return block

    return PanelCholesky(len(rows), panel)


def _mean_row(layout: CentreLayout, support_radius: float) -> float:
    """Mean number of nonzero entries per row; the full row if a search is not worth its time."""
    return float(layout.n_centres) if layout.is_direct else mean_row_entries(layout, support_radius)


def _automatic(layout: CentreLayout, support_radius: float) -> str:
    """Name of the solver for these points."""
    n = layout.n_centres
    if n > _SPARSE_ORDER and not layout.is_direct:
        row = mean_row_entries(layout, support_radius)
        if row <= _SPARSE_ROW and n * row <= _SPARSE_ENTRIES:
            return "sparse"
    return "dense" if n <= _DENSE_ORDER else "iterative"
