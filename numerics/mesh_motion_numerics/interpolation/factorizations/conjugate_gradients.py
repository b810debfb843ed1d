"""Preconditioned conjugate gradients for several right-hand sides that advance together.

Each iteration applies the matrix once for all of them; each has its own steps. Sums over rows are formed in fixed
blocks: bitwise the same for any number of threads.
"""

from collections.abc import Callable
from typing import NamedTuple

import mesh_motion_kernels as kernels
import numpy as np

from mesh_motion_numerics.arrays import Floats


class Iterated(NamedTuple):
    """The result of the iterations: solution and recurrences' residual (n, k), and the number of iterations."""

    solution: Floats
    residual: Floats
    iterations: int


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
