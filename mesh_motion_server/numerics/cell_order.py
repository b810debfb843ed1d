"""Cells in the lexicographic order of their nodes: one bucket for each first node, each sorted by the other nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.numerics.read_only import read_only
from mesh_motion_server.numerics.thread_share import threads_for

__all__ = ["first_repetition", "sorted_cells", "sorted_in_buckets"]

Ints = NDArray[np.int64]

_NODES_PER_ITEM = 2048  # buckets per work item of the parallel loop
_FEW = 4096  # cells that are sorted before a kernel is loaded
_INSERTION_SORT = 64  # longest bucket sorted by insertion: first node of a good mesh's cells are about 6


def sorted_cells(pieces: Sequence[tuple[Ints, Ints]], nodes: int) -> tuple[Ints, NDArray[Any]]:
    """Cells of one type, renumbered and sorted.

    Parameters
    ----------
    pieces : sequence of (node map, cells)
        New number of each node that the cells (m_i, k) name, and these cells; every number in range.
    nodes : int
        The new numbers are below.

    Returns
    -------
    (m, k) int64 array
        Rows ascending; equal ones in the order they came.
    (m,) int32 or int64 array
        Where each row came from, counted through the pieces.
    """
    if sum(len(cells) for _, cells in pieces) > _FEW:
        return sorted_in_buckets(pieces, nodes)
    rows = np.concatenate([node_map[cells] for node_map, cells in pieces])
    order = np.lexsort(rows.T[::-1])
    return rows[order], order.astype(np.int32)


def sorted_in_buckets(pieces: Sequence[tuple[Ints, Ints]], nodes: int) -> tuple[Ints, NDArray[Any]]:
    """As :func:`sorted_cells` does it with many."""
    width = np.int32 if nodes <= 2**31 else np.int64  # one for all, for which the kernels are compiled
    given = [(read_only(node_map), read_only(np.ascontiguousarray(cells, dtype=width))) for node_map, cells in pieces]
    total, starts = sum(len(cells) for _, cells in given), np.zeros(nodes + 1, dtype=np.int64)
    for node_map, cells in given:
        _count(node_map, cells, starts[1:])
    np.cumsum(starts, out=starts)
    rows = np.empty((total, given[0][1].shape[1]), dtype=np.int64)
    # kept as long as the session: half the memory where the numbers allow it
    order = np.empty(total, dtype=np.int32 if total < 2**31 else np.int64)
    place, first = starts[:-1].copy(), 0
    for node_map, cells in given:
        _place(node_map, cells, first, place, rows, order)
        first += len(cells)
    with threads_for(nodes // _NODES_PER_ITEM):
        _sort_short(starts, rows, order)
    for node in np.flatnonzero(np.diff(starts) > _INSERTION_SORT):
        bucket = slice(starts[node], starts[node + 1])
        ascending = np.lexsort(rows[bucket].T[::-1])
        rows[bucket], order[bucket] = rows[bucket][ascending], order[bucket][ascending]
    return rows, order


def first_repetition(rows: Ints) -> int | None:
    """The first of sorted rows (m, k) that equals the one before it."""
    same = np.flatnonzero(rows[1:, -1] == rows[:-1, -1])  # few neighbours agree in this column, most in the first
    same = same[(rows[same + 1] == rows[same]).all(axis=1)]
    return int(same[0]) + 1 if len(same) else None


@njit(cache=True)
def _count(node_map, cells, counts):  # type: ignore[no-untyped-def]
    """Add the cells to the counts of their first nodes."""
    for e in range(cells.shape[0]):
        counts[node_map[cells[e, 0]]] += 1


@njit(cache=True)
def _place(node_map, cells, first, place, rows, order):  # type: ignore[no-untyped-def]
    """Put the renumbered cells where the next row of their first node goes."""
    for e in range(cells.shape[0]):
        node = node_map[cells[e, 0]]
        at = place[node]
        place[node] += 1
        for k in range(cells.shape[1]):
            rows[at, k] = node_map[cells[e, k]]
        order[at] = first + e


@njit(cache=True, parallel=True)
def _sort_short(starts, rows, order):  # type: ignore[no-untyped-def]
    """Sort the rows of every short bucket by insertion."""
    n, width = starts.size - 1, rows.shape[1]
    for item in prange((n + _NODES_PER_ITEM - 1) // _NODES_PER_ITEM):
        row = np.empty(width, dtype=np.int64)
        for node in range(item * _NODES_PER_ITEM, min(n, (item + 1) * _NODES_PER_ITEM)):
            begin, end = starts[node], starts[node + 1]
            if end - begin > _INSERTION_SORT:
                continue
            for i in range(begin + 1, end):
                if not _less(rows[i], rows[i - 1]):
                    continue
                number, j = order[i], i
                for k in range(width):
                    row[k] = rows[i, k]
                while j > begin and _less(row, rows[j - 1]):
                    for k in range(width):
                        rows[j, k] = rows[j - 1, k]
                    order[j] = order[j - 1]
                    j -= 1
                for k in range(width):
                    rows[j, k] = row[k]
                order[j] = number


@njit(cache=True)
def _less(a, b):  # type: ignore[no-untyped-def]
    """Whether row ``a`` (k,) comes before row ``b``."""
    for k in range(a.size):
        if a[k] != b[k]:
            return a[k] < b[k]
    return False
