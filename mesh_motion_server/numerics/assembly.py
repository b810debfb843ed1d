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

__all__ = ["dense_block", "mean_row_entries", "sparse_matrix"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


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
    centres: Array, inverse_radius: float, origin: Array, inverse_side: float, shape: Integers, starts: Integers
) -> Integers:
    """Centres closer than R to each sorted centre, itself included."""
    counts = np.zeros(centres.shape[1], dtype=np.int64)
    for i in prange(centres.shape[1]):
        x, y, z = centres[0, i], centres[1, i], centres[2, i]
        runs = np.empty((MAX_RUNS, 2), dtype=np.int64)
        for run in range(centre_runs(x, y, z, origin, inverse_side, shape, starts, runs)):
            for j in range(runs[run, 0], runs[run, 1]):
                dx, dy, dz = x - centres[0, j], y - centres[1, j], z - centres[2, j]
                if math.sqrt(dx * dx + dy * dy + dz * dz) * inverse_radius < 1.0:
                    counts[i] += 1
    return counts


@njit(cache=True, error_model="numpy", parallel=True)
def _fill_rows(
    code: int,
    centres: Array,
    inverse_radius: float,
    origin: Array,
    inverse_side: float,
    shape: Integers,
    starts: Integers,
    pointers: Integers,
    columns: NDArray[np.int32],
    entries: Array,
) -> None:
    """Columns (ascending) and entries of each row; ``pointers`` from the counts."""
    for i in prange(centres.shape[1]):
        x, y, z = centres[0, i], centres[1, i], centres[2, i]
        runs = np.empty((MAX_RUNS, 2), dtype=np.int64)
        at = pointers[i]
        for run in range(centre_runs(x, y, z, origin, inverse_side, shape, starts, runs)):
            for j in range(runs[run, 0], runs[run, 1]):
                dx, dy, dz = x - centres[0, j], y - centres[1, j], z - centres[2, j]
                xi = math.sqrt(dx * dx + dy * dy + dz * dz) * inverse_radius
                if xi < 1.0:
                    columns[at] = j
                    entries[at] = xi
                    at += 1
        map_phi(code, entries[pointers[i] : at])


def mean_row_entries(layout: CentreLayout, support_radius: float) -> float:
    """Mean number of centres closer than R to a centre: nonzero entries a row of the matrix of a compact basis."""
    return float(np.mean(_row_counts(layout, support_radius)))


def _row_counts(layout: CentreLayout, support_radius: float) -> Integers:
    with threads_for(layout.fraction * layout.n_centres**2):
        counts: Integers = _count_rows(layout.coordinates, 1.0 / support_radius, *layout.grid())
    return counts


def sparse_matrix(layout: CentreLayout, basis: Basis, support_radius: float) -> csr_array:
    """(nc, nc) interpolation matrix of a compact basis, rows and columns in the layout's order."""
    counts = _row_counts(layout, support_radius)
    pointers = np.zeros(layout.n_centres + 1, dtype=np.int64)
    np.cumsum(counts, out=pointers[1:])
    columns = np.empty(pointers[-1], dtype=np.int32)
    entries = np.empty(pointers[-1])
    inverse_radius = 1.0 / support_radius
    with threads_for(layout.fraction * layout.n_centres**2):
        _fill_rows(basis.code, layout.coordinates, inverse_radius, *layout.grid(), pointers, columns, entries)
    return csr_array((entries, columns, pointers.astype(np.int32)), shape=(layout.n_centres,) * 2)
