"""Entries of the interpolation matrix: dense blocks, and sparse rows found through the cells of centres."""

from typing import NamedTuple

import mesh_motion_kernels as kernels
import numpy as np
from scipy.sparse import csr_array

from mesh_motion_numerics.arrays import Floats, Integers, Shorts
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.kernels import Basis
from mesh_motion_numerics.interpolation.sparse_rows import SparseRows

#: Largest width, in radii, of a grid's cells or of all centres; beyond it, a grid that stores few of its cells is used.
_WIDER = 1.5
#: Cells are this much wider than R, so that rounding of a cell number cannot lose a neighbour.
_SLACK = 1.0 + 1e-6


def dense_block(basis: Basis, support_radius: float, rows: Floats, columns: Floats) -> Floats:
    """(m, n) block of φ between (m, 3) and (n, 3) points."""
    out = np.empty((len(rows), len(columns)))
    columns = np.ascontiguousarray(columns.T)
    kernels.fill_block(basis.code, np.ascontiguousarray(rows), columns, 1.0 / support_radius, out)
    return out


class _Search(NamedTuple):
    """The data to find the centres near a place."""

    order: Integers  # (nc,). Row ``j`` of the sorted centres is centre ``order[j]`` of the layout
    coordinates: Floats  # (3, nc)
    #: Origin, inverse side, shape, starts, and the three arrays of the table of stored cells; without keys all cells
    #: are stored.
    grid: tuple[Floats, float, Integers, Integers, Integers, Shorts, Shorts]


def _search(layout: CentreLayout, support_radius: float) -> _Search:
    """Return the layout's own grid, or a grid of small cells if the layout's cells are far wider than R."""
    wider = layout.inverse_side * support_radius * _WIDER < 1.0
    none = np.empty(0, dtype=np.int64)
    if not wider or layout.extent < _WIDER * support_radius or not layout.n_centres:
        order, empty = np.arange(layout.n_centres), np.empty((0, 2), dtype=np.int32)
        grid = (*layout.grid, none, empty, empty)
        return _Search(order, layout.coordinates, grid)
    fine = layout.small_cells(support_radius * _SLACK)
    grid = (fine.origin, fine.inverse_side, none, none, fine.keys, fine.spans, fine.runs)
    return _Search(fine.order, fine.coordinates, grid)


def rows_near(
    layout: CentreLayout, support_radius: float, points: Floats, *, skipped: Integers | None = None
) -> tuple[Integers, Floats]:
    """Rows (r,) of (n, d) points that may be closer than R to a centre, and these points (r, 3), sorted by cell.

    The ``skipped`` rows (u,) are left out.
    """
    search = _search(layout, support_radius)
    left_out = np.empty(0, dtype=np.int64) if skipped is None else skipped
    found: tuple[Integers, Floats] = kernels.rows_near(
        np.ascontiguousarray(points), left_out, search.coordinates, *search.grid
    )
    return found


def mean_row_entries(layout: CentreLayout, support_radius: float) -> float:
    """Mean number of centres closer than R to a centre: nonzero entries a row of the matrix of a compact basis."""
    points, search = np.ascontiguousarray(layout.coordinates.T), _search(layout, support_radius)
    return float(np.mean(kernels.count_near(points, search.coordinates, support_radius, *search.grid)))


def sparse_matrix(layout: CentreLayout, basis: Basis, support_radius: float) -> csr_array:
    """(nc, nc) interpolation matrix of a compact basis, rows and columns in the layout's order."""
    points, search = np.ascontiguousarray(layout.coordinates.T), _search(layout, support_radius)
    return _sparse(search, basis, support_radius, points, search.order).matrix(len(points))


def sparse_rows(layout: CentreLayout, basis: Basis, support_radius: float, points: Floats) -> SparseRows:
    """(n, nc) values of a compact basis at (n, 3) points, columns in the control points' own order."""
    search = _search(layout, support_radius)
    return _sparse(search, basis, support_radius, points, layout.order[search.order])


def _sparse(search: _Search, basis: Basis, support_radius: float, points: Floats, numbers: Integers) -> SparseRows:
    """φ between points (n, 3) and the sorted centres, which have the column ``numbers`` (nc,)."""
    return SparseRows(*kernels.near_rows(basis.code, points, search.coordinates, numbers, support_radius, *search.grid))
