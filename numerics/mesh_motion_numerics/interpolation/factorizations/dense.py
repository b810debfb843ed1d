"""Cholesky factorization of a dense matrix, by panels of its lower triangle.

Left-looking: panel j is assembled, the products of the panels before it are subtracted, and it is divided by the factor
of its diagonal block. Only panels are stored, together half of the square matrix; nothing else of that size is
allocated. LAPACK's factorization of orders near 18 000 can crash a process; here it gets blocks of a few hundred rows.
"""

from collections.abc import Callable

import numpy as np
from mesh_motion_protocol.errors import QualityRefused
from scipy.linalg import lapack

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.blas import for_each_tile, one_blas_thread

#: Columns per panel: wide enough for full speed of the products, narrow enough that the diagonal blocks cost little.
_PANEL = 512
#: Rows per tile: one task of one thread.
_TILE = 512
LOST = 64 * float(np.finfo(float).eps)
"""A pivot this small relative to the diagonal has no correct digits."""


class PanelCholesky:
    """``A = L Lᵀ`` with L in panels of columns.

    Raises QualityRefused if a pivot vanishes relative to the diagonal of A: it is only rounding.

    Parameters
    ----------
    order : int
        n.
    panel : callable
        ``panel(first, last)`` gives a fresh (n − first, last − first) array: columns first … last of A, from the
        diagonal down.
    """

    name = "dense"

    def __init__(self, order: int, panel: Callable[[int, int], Floats]) -> None:
        self._bounds = [(first, min(first + _PANEL, order)) for first in range(0, order, _PANEL)]
        self._panels: list[Floats] = []
        with one_blas_thread():
            for first, last in self._bounds:
                self._panels.append(self._eliminate(panel(first, last), first, last))

    def _eliminate(self, block: Floats, first: int, last: int) -> Floats:
        """Turn columns of A into columns of L."""
        width = last - first
        largest = float(np.max(np.diag(block)))
        earlier = [panel[first - start :] for panel, (start, _) in zip(self._panels, self._bounds, strict=False)]

        def subtract(top: int, bottom: int) -> None:
            for left in earlier:
                block[top:bottom] -= left[top:bottom] @ left[:width].T

        for_each_tile(subtract, len(block), _TILE)
        diagonal = block[:width] = _factor_block(block[:width], LOST * largest)

        def divide(top: int, bottom: int) -> None:
            rows = slice(width + top, width + bottom)
            block[rows] = _divided(block[rows].T, diagonal).T

        for_each_tile(divide, len(block) - width, _TILE)
        return block

    def solve(self, values: Floats) -> Floats:
        """(n, k) solution of ``A x = values``."""
        x = np.array(values, dtype=np.float64)
        with one_blas_thread():
            for panel, (first, last) in zip(self._panels, self._bounds, strict=True):
                width = last - first
                x[first:last] = _divided(x[first:last], panel[:width])
                x[last:] -= panel[width:] @ x[first:last]
            for panel, (first, last) in zip(self._panels[::-1], self._bounds[::-1], strict=True):
                width = last - first
                x[first:last] -= panel[width:].T @ x[last:]
                x[first:last] = _divided(x[first:last], panel[:width], transposed=True)
        return x


def _factor_block(block: Floats, smallest: float) -> Floats:
    """Lower Cholesky factor, in place, of a diagonal block whose pivots are all larger than ``smallest``.

    Above its diagonal the block stays unchanged.
    """
    factor, failed = lapack.dpotrf(block.T, lower=0, clean=0, overwrite_a=1)  # its transpose, as LAPACK stores it
    if failed or float(np.min(np.diag(factor))) ** 2 <= smallest:
        raise singular()
    return np.asarray(factor.T)


def _divided(values: Floats, lower: Floats, *, transposed: bool = False) -> Floats:
    """``L⁻¹`` or ``L⁻ᵀ`` times values (n, k), by LAPACK directly: SciPy's checks take longer than a small solution."""
    found, _ = lapack.dtrtrs(lower.T, values, lower=0, trans=0 if transposed else 1)
    return np.asarray(found)


def singular() -> QualityRefused:
    """The error for a matrix with a pivot that is only rounding."""
    return QualityRefused(
        "the interpolation matrix is singular to working precision",
        code="FAILED_PRECONDITION",
        hint="take a smaller support radius or a less smooth basis, or separate control points that nearly coincide",
        details={"setting": "support_radius"},
    )
