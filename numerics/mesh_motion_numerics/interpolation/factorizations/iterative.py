"""Preconditioned conjugate gradients for many control points, in memory proportional to their number.

The matrix is applied by the same compiled sums that evaluate the interpolant (stored rows are faster only where a
sparse factorization is faster still); the preconditioner is a factorized sparse approximate inverse
(``preconditioner.py``). All right-hand sides advance together, so each iteration applies the matrix once; each has its
own steps. Sums over rows are formed in fixed blocks: bitwise the same for any number of threads.

Because of rounding the recurrences' residual drifts from the true one. So the true residual is computed at the end, and
the system is solved for it again as long as that helps.
"""

from collections.abc import Callable

import mesh_motion_kernels as kernels
import numpy as np
from mesh_motion_protocol.errors import QualityRefused

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.factorizations.preconditioner import Iterated, SparseInverse
from mesh_motion_numerics.interpolation.kernels import Basis

#: Relative residual of the recurrences at which the iterations end: boundary values are then exact to 1e-12 in the
#: maximum norm, unless rounding prevents it.
_TOLERANCE = 1e-13
#: A true residual above this is worth another round; below it, only rounding of the sums is left.
_REFINED = 1e-10
#: A relative residual that refinement cannot reduce below this is an error: the error at the boundary would be visible.
_ACCEPTED = 1e-8
_MAX_ITERATIONS = 1000
#: After this number of iterations without halving the best residual, rounding dominates.
_PATIENCE = 25
_REFINEMENTS = 3
#: Preceding points per row of the preconditioner. Many if a row of the matrix has more than this number of terms: then
#: fewer iterations save more time than the longer set-up costs.
_LONG_ROW, _NEIGHBOURS_LONG, _NEIGHBOURS_SHORT = 2000.0, 64, 24


class ConjugateGradients:
    """Solver by conjugate gradients.

    Parameters
    ----------
    basis : Basis
        Positive definite.
    """

    name = "iterative"

    def __init__(self, layout: CentreLayout, basis: Basis, support_radius: float) -> None:
        self._layout, self._basis, self._radius = layout, basis, support_radius
        self._points = np.ascontiguousarray(layout.coordinates.T)
        long = layout.fraction * layout.n_centres > _LONG_ROW
        neighbours = _NEIGHBOURS_LONG if long else _NEIGHBOURS_SHORT
        self._precondition = SparseInverse(self._points, basis, support_radius, neighbours)
        self.iterations = 0

    def solve(self, values: Floats) -> Floats:
        """(n, k) solution, rows in the caller's order.

        Raises QualityRefused if the residual stays above 1e-8 of the right-hand side.
        """
        rhs = np.ascontiguousarray(values[self._layout.order])
        scale = np.sqrt(np.sum(rhs * rhs, axis=0))
        scale[scale == 0.0] = 1.0
        x = np.zeros_like(rhs)
        residual, error = rhs, 1.0
        self.iterations = 0
        for _ in range(_REFINEMENTS):
            trial = x + self._conjugate_gradients(residual, scale)
            trial_residual = rhs - self._apply(trial)
            trial_error = _largest(trial_residual, scale)
            if not trial_error < error:
                break
            x, residual, error = trial, trial_residual, trial_error
            if error <= _REFINED:
                break
        if error > _ACCEPTED:
            raise QualityRefused(
                f"the iterative solution of the interpolation stopped at a relative residual of {error:.1e}",
                hint="take a smaller support radius",
            )
        out = np.empty_like(x)
        out[self._layout.order] = x
        return out

    def _apply(self, vectors: Floats) -> Floats:
        """(n, k) product with the matrix, rows in the layout's order."""
        return self._layout.product(self._basis, self._radius, self._points, vectors)

    def _conjugate_gradients(self, rhs: Floats, scale: Floats) -> Floats:
        """(n, k) solution for ``rhs`` to the tolerance times ``scale``, or as well as rounding allows."""
        best, since = np.inf, 0

        def done(residual: Floats) -> bool:
            nonlocal best, since
            error = _largest(residual, scale)
            best, since = (error, 0) if error < best / 2.0 else (best, since + 1)
            return error <= _TOLERANCE or since >= _PATIENCE

        found = conjugate_gradients(
            rhs, apply=self._apply, precondition=self._precondition, done=done, most=_MAX_ITERATIONS
        )
        self.iterations += found.iterations
        return found.solution


def _largest(residual: Floats, scale: Floats) -> float:
    return float(np.max(np.sqrt(np.sum(residual * residual, axis=0)) / scale))


def conjugate_gradients(
    right: Floats,
    *,
    apply: Callable[[Floats], Floats],
    precondition: Callable[[Floats], Floats],
    done: Callable[[Floats], bool],
    most: int,
) -> Iterated:
    """Solve for right-hand sides (n, k).

    Parameters
    ----------
    right : (n, k) array
    apply, precondition : callable
        Products (n, k) of the matrix and of its approximate inverse with (n, k) vectors.
    done : callable
        Whether to stop at a residual (n, k); called after every iteration.
    most : int
        Largest number of iterations.
    """
    x, r = np.zeros_like(right), right.copy()
    z = precondition(r)
    p, rz = z.copy(), kernels.column_products(r, z)
    for iteration in range(1, most + 1):
        ap = apply(p)
        kernels.advance_columns(x, r, p, ap, _ratio(rz, kernels.column_products(p, ap)))
        if done(r):
            return Iterated(x, r, iteration)
        z = precondition(r)
        rz, before = kernels.column_products(r, z), rz
        kernels.redirect_columns(p, z, _ratio(rz, before))
    return Iterated(x, r, most)


def _ratio(a: Floats, b: Floats) -> Floats:
    """``a / b`` column by column; 0 in a column that is solved."""
    safe = np.where(b > 0.0, b, 1.0)
    return np.where(b > 0.0, a / safe, 0.0)
