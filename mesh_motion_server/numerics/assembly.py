"""Entries of the interpolation matrix, compiled: dense blocks, and sparse rows found through the cells of centres."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray
from scipy.sparse import csr_array

from mesh_motion_server.numerics.centres import CentreLayout
from mesh_motion_server.numerics.hashed_cells import MAX_HASHED_RUNS, hashed_runs
from mesh_motion_server.numerics.kernel_maps import map_phi
from mesh_motion_server.numerics.kernels import Basis
from mesh_motion_server.numerics.summation import MAX_RUNS, centre_runs
from mesh_motion_server.numerics.threads import threads_for

__all__ = ["dense_block", "mean_row_entries", "sparse_matrix", "sparse_rows"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Shorts = NDArray[np.int32]

_BLOCK = 64  # rows of one task
_MOST_RUNS = max(MAX_RUNS, MAX_HASHED_RUNS)
#: Radii that a grid's cells, or all centres, may be wide before a grid that stores few of its cells is made.
_WIDER = 1.5
#: Cells are this much wider than R, so that rounding of a cell number cannot lose a neighbour.
_SLACK = 1.0 + 1e-6
#: A search among stored cells, in evaluations of a basis function.
_HASHED_WORK = 100.0


@njit(cache=True, error_model="numpy", parallel=True)
def _fill_block(code: int, rows: Array, columns: Array, inverse_radius: float, out: Array) -> None:
    """``out[i, j] = φ(|rows[i] − columns[:, j]|/R)``."""
    for i in prange(rows.shape[0]):
        x, y, z = rows[i, 0], rows[i, 1], rows[i, 2]
        for j in range(columns.shape[1]):
            dx, dy, dz = x - columns[0, j], y - columns[1, j], z - columns[2, j]
            out[i, j] = math.sqrt(dx * dx + dy * dy + dz * dz) * inverse_radius
        map_phi(code, out[i])


def dense_block(basis: Basis, support_radius: float, rows: Array, columns: Array) -> Array:
    """(m, n) block of φ between (m, 3) and (n, 3) points."""
    out = np.empty((len(rows), len(columns)))
    with threads_for(out.size):
        _fill_block(basis.code, rows, np.ascontiguousarray(columns.T), 1.0 / support_radius, out)
    return out


@njit(cache=True, error_model="numpy", inline="always")
def _runs(x, y, z, grid, runs):  # type: ignore[no-untyped-def]
    """Fill ``runs`` with [first, last) of the centres near a place; the count. ``grid`` as :class:`_Search` has it."""
    origin, inverse_side, shape, starts, keys, spans, stored = grid
    if keys.size:
        count = hashed_runs(x, y, z, origin, inverse_side, keys, spans, stored, runs)
    else:
        count = centre_runs(x, y, z, origin, inverse_side, shape, starts, runs)
    return count


@njit(cache=True, error_model="numpy", parallel=True)
def _count_rows(points, centres, radius, grid):  # type: ignore[no-untyped-def]
    """Centres (3, nc) closer than R to each of (n, 3) points."""
    n = len(points)
    counts = np.empty(n, dtype=np.int64)
    for block in prange((n + _BLOCK - 1) // _BLOCK):
        runs = np.empty((_MOST_RUNS, 2), dtype=np.int64)
        for i in range(block * _BLOCK, min(n, (block + 1) * _BLOCK)):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            count = 0
            for run in range(_runs(x, y, z, grid, runs)):
                for j in range(runs[run, 0], runs[run, 1]):
                    dx, dy, dz = x - centres[0, j], y - centres[1, j], z - centres[2, j]
                    count += dx * dx + dy * dy + dz * dz < radius * radius
            counts[i] = count
    return counts


@njit(cache=True, error_model="numpy")
def _fill_some(rows, code, points, centres, numbers, radius, grid, pointers, columns, entries):  # type: ignore[no-untyped-def]
    """:func:`_fill_rows` for a range of rows."""
    runs = np.empty((_MOST_RUNS, 2), dtype=np.int64)
    near, squares = np.empty(_BLOCK, dtype=np.int64), np.empty(_BLOCK)
    for i in rows:
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        count, visited, found = _runs(x, y, z, grid, runs), 0, 0
        for run in range(count):
            visited += runs[run, 1] - runs[run, 0]
        if visited > len(near):
            near, squares = np.empty(2 * visited, dtype=np.int64), np.empty(2 * visited)
        for run in range(count):
            for j in range(runs[run, 0], runs[run, 1]):  # kept or written over by the next: no branch to guess wrong
                dx, dy, dz = x - centres[0, j], y - centres[1, j], z - centres[2, j]
                near[found], squares[found] = j, dx * dx + dy * dy + dz * dz
                found += squares[found] < radius * radius
        at = pointers[i]
        for e in range(found):
            columns[at + e] = numbers[near[e]]
        for e in range(found):
            entries[at + e] = math.sqrt(squares[e]) / radius
        map_phi(code, entries[at : at + found])


@njit(cache=True, error_model="numpy", parallel=True)
def _fill_rows(code, points, centres, numbers, radius, grid, pointers, columns, entries):  # type: ignore[no-untyped-def]
    """Entries of each row in the order of the sorted centres.

    Parameters
    ----------
    code : int
    points, centres : (n, 3), (3, nc) arrays
    numbers : (nc,) int64 array
        What the columns call the centres.
    radius : float
    grid : tuple
    pointers : (n + 1,) int32 array
        By the counts.
    columns, entries : (e,) int32, float64 arrays
    """
    n = len(points)
    for block in prange((n + _BLOCK - 1) // _BLOCK):
        rows = range(block * _BLOCK, min(n, (block + 1) * _BLOCK))
        _fill_some(rows, code, points, centres, numbers, radius, grid, pointers, columns, entries)


class _Search(NamedTuple):
    """What finds the centres near a place.

    Attributes
    ----------
    order : (nc,) int64 array
        Row ``j`` of the sorted centres is centre ``order[j]`` of the layout.
    coordinates : (3, nc) array
    grid : tuple
        Origin, inverse side, shape, starts, and the three of the table of stored cells; without keys all are stored.
    work : float
        Centres visited for each place, roughly.
    """

    order: Integers
    coordinates: Array
    grid: tuple[Array, float, Integers, Integers, Integers, Shorts, Shorts]
    work: float


def _search(layout: CentreLayout, support_radius: float) -> _Search:
    """The layout's own grid, or one of small cells where its cells had to be far wider than R."""
    wider = layout.inverse_side * support_radius * _WIDER < 1.0
    none = np.empty(0, dtype=np.int64)
    if not wider or float(np.ptp(layout.coordinates, axis=1).max()) < _WIDER * support_radius:
        order, empty = np.arange(layout.n_centres), np.empty((0, 2), dtype=np.int32)
        grid = (*layout.grid(), none, empty, empty)
        return _Search(order, layout.coordinates, grid, layout.fraction * layout.n_centres)
    fine = layout.small_cells(support_radius * _SLACK)
    grid = (fine.origin, fine.inverse_side, none, none, fine.keys, fine.spans, fine.runs)
    return _Search(fine.order, fine.coordinates, grid, _HASHED_WORK)


def mean_row_entries(layout: CentreLayout, support_radius: float) -> float:
    """Mean number of centres closer than R to a centre: nonzero entries a row of the matrix of a compact basis."""
    points = np.ascontiguousarray(layout.coordinates.T)
    return float(np.mean(_row_counts(_search(layout, support_radius), support_radius, points)))


def _row_counts(search: _Search, support_radius: float, points: Array) -> Integers:
    with threads_for(search.work * len(points)):
        counts: Integers = _count_rows(points, search.coordinates, support_radius, search.grid)
    return counts


def sparse_matrix(layout: CentreLayout, basis: Basis, support_radius: float) -> csr_array:
    """(nc, nc) interpolation matrix of a compact basis, rows and columns in the layout's order."""
    points, search = np.ascontiguousarray(layout.coordinates.T), _search(layout, support_radius)
    return _sparse(search, basis, support_radius, points, search.order)


def sparse_rows(layout: CentreLayout, basis: Basis, support_radius: float, points: Array) -> csr_array:
    """(n, nc) values of a compact basis at (n, 3) points, columns in the control points' own order."""
    search = _search(layout, support_radius)
    return _sparse(search, basis, support_radius, points, layout.order[search.order])


def _sparse(search: _Search, basis: Basis, support_radius: float, points: Array, numbers: Integers) -> csr_array:
    """φ between points (n, 3) and the sorted centres, which are called by their ``numbers`` (nc,)."""
    pointers = np.zeros(len(points) + 1, dtype=np.int32)
    np.cumsum(_row_counts(search, support_radius, points), out=pointers[1:])
    columns, entries = np.empty(pointers[-1], dtype=np.int32), np.empty(pointers[-1])
    centres = search.coordinates
    with threads_for(search.work * len(points)):
        _fill_rows(basis.code, points, centres, numbers, support_radius, search.grid, pointers, columns, entries)
    return csr_array((entries, columns, pointers), shape=(len(points), len(numbers)))
