"""Entries of the interpolation matrix, compiled: dense blocks, and sparse rows found through the cells of centres."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray
from scipy.sparse import csr_array

from mesh_motion_server.numerics.centres import CentreLayout
from mesh_motion_server.numerics.kernel_maps import map_phi
from mesh_motion_server.numerics.kernels import Basis
from mesh_motion_server.numerics.summation import MAX_RUNS, centre_runs
from mesh_motion_server.numerics.threads import threads_for

__all__ = ["dense_block", "mean_row_entries", "sparse_matrix", "sparse_rows"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_BLOCK = 64  # rows of one task


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


@njit(cache=True, error_model="numpy", parallel=True)
def _count_rows(
    points: Array, centres: Array, radius: float, origin: Array, inverse_side: float, shape: Integers, starts: Integers
) -> Integers:
    """Centres closer than R to each of (n, 3) points."""
    n = len(points)
    counts = np.zeros(n, dtype=np.int64)
    for block in prange((n + _BLOCK - 1) // _BLOCK):
        runs = np.empty((MAX_RUNS, 2), dtype=np.int64)
        for i in range(block * _BLOCK, min(n, (block + 1) * _BLOCK)):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            for run in range(centre_runs(x, y, z, origin, inverse_side, shape, starts, runs)):
                for j in range(runs[run, 0], runs[run, 1]):
                    dx, dy, dz = x - centres[0, j], y - centres[1, j], z - centres[2, j]
                    counts[i] += dx * dx + dy * dy + dz * dz < radius * radius
    return counts


@njit(cache=True, error_model="numpy")
def _fill_some(rows, code, points, centres, numbers, radius, grid, pointers, columns, entries):  # type: ignore[no-untyped-def]
    """:func:`_fill_rows` for a range of rows."""
    origin, inverse_side, shape, starts = grid
    runs = np.empty((MAX_RUNS, 2), dtype=np.int64)
    near, squares = np.empty(_BLOCK, dtype=np.int64), np.empty(_BLOCK)
    for i in rows:
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        count, visited, found = centre_runs(x, y, z, origin, inverse_side, shape, starts, runs), 0, 0
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
def _fill_rows(
    code: int,
    points: Array,
    centres: Array,
    numbers: Integers,
    radius: float,
    origin: Array,
    inverse_side: float,
    shape: Integers,
    starts: Integers,
    pointers: NDArray[np.int32],
    columns: NDArray[np.int32],
    entries: Array,
) -> None:
    """Entries of each row in the order of the sorted centres, columns by their ``numbers``; ``pointers`` by counts."""
    n, grid = len(points), (origin, inverse_side, shape, starts)
    for block in prange((n + _BLOCK - 1) // _BLOCK):
        rows = range(block * _BLOCK, min(n, (block + 1) * _BLOCK))
        _fill_some(rows, code, points, centres, numbers, radius, grid, pointers, columns, entries)


def mean_row_entries(layout: CentreLayout, support_radius: float) -> float:
    """Mean number of centres closer than R to a centre: nonzero entries a row of the matrix of a compact basis."""
    return float(np.mean(_row_counts(layout, support_radius, np.ascontiguousarray(layout.coordinates.T))))


def _row_counts(layout: CentreLayout, support_radius: float, points: Array) -> Integers:
    with threads_for(layout.fraction * layout.n_centres * len(points)):
        counts: Integers = _count_rows(points, layout.coordinates, support_radius, *layout.grid())
    return counts


def sparse_matrix(layout: CentreLayout, basis: Basis, support_radius: float) -> csr_array:
    """(nc, nc) interpolation matrix of a compact basis, rows and columns in the layout's order."""
    points = np.ascontiguousarray(layout.coordinates.T)
    return _sparse(layout, basis, support_radius, points, np.arange(layout.n_centres))


def sparse_rows(layout: CentreLayout, basis: Basis, support_radius: float, points: Array) -> csr_array:
    """(n, nc) values of a compact basis at (n, 3) points, columns in the control points' own order."""
    return _sparse(layout, basis, support_radius, points, layout.order)


def _sparse(layout: CentreLayout, basis: Basis, support_radius: float, points: Array, numbers: Integers) -> csr_array:
    """φ between points (n, 3) and the centres, which are called by their ``numbers`` (nc,)."""
    pointers = np.zeros(len(points) + 1, dtype=np.int32)
    np.cumsum(_row_counts(layout, support_radius, points), out=pointers[1:])
    columns, entries = np.empty(pointers[-1], dtype=np.int32), np.empty(pointers[-1])
    with threads_for(layout.fraction * layout.n_centres * len(points)):
        _fill_rows(
            basis.code,
            points,
            layout.coordinates,
            numbers,
            support_radius,
            *layout.grid(),
            pointers,
            columns,
            entries,
        )
    return csr_array((entries, columns, pointers), shape=(len(points), layout.n_centres))
