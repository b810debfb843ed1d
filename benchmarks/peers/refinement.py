"""Tetrahedra split into eight of half the size: four at the corners, four of the octahedron that remains.

New nodes lie at the midpoints of the edges, so that a flat boundary stays flat. The octahedron is cut along its
shortest diagonal, which keeps the cells' shapes from worsening with every refinement (Bey 1995 chooses it by number).
Edges are found in one bucket per smaller node: nothing larger than the new mesh is ever held.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["refined_tetrahedra"]

Floats = NDArray[np.float64]
Rows = NDArray[np.int32]

#: Corners of each edge; the midpoint of edge i is local node 4 + i.
_EDGES = np.array([(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)])
_CORNERS = ((0, 4, 5, 6), (4, 1, 7, 8), (5, 7, 2, 9), (6, 8, 9, 3))
#: The octahedron's diagonals, each with the four other midpoints going round it.
_DIAGONALS = (((4, 9), (5, 7, 8, 6)), ((5, 8), (4, 7, 9, 6)), ((6, 7), (4, 8, 9, 5)))


def refined_tetrahedra(points: Floats, cells: NDArray[Any]) -> tuple[Floats, Rows]:
    """Each tetrahedron as eight.

    Parameters
    ----------
    points : (n, 3) array
    cells : (m, 4) integer array
        Positively oriented.

    Returns
    -------
    (n + e, 3) array
        The nodes, then the midpoints of the e edges.
    (8 m, 4) int32 array
    """
    cells = np.ascontiguousarray(cells, dtype=np.int32)
    starts, ends = _edges(cells, len(points), _EDGES)
    lower = np.repeat(np.arange(len(points)), np.diff(starts))
    refined = np.concatenate([points, (points[lower] + points[ends]) / 2])
    return refined, _split(refined, cells, len(points), starts, ends, _EDGES, _children())


def _children() -> NDArray[np.int64]:
    """(3, 8, 4) local nodes of the parts for each diagonal, positively oriented."""
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], dtype=np.float64)
    nodes = np.concatenate([corners, corners[_EDGES].mean(axis=1)])
    tables = []
    for (a, b), ring in _DIAGONALS:
        around = [(a, b, ring[i], ring[(i + 1) % 4]) for i in range(4)]
        parts = [*_CORNERS, *around]
        tables.append([_positive(nodes, part) for part in parts])
    return np.array(tables)


def _positive(nodes: Floats, part: tuple[int, int, int, int]) -> tuple[int, int, int, int]:
    """The part with two nodes swapped where its volume was negative."""
    edges = nodes[list(part[1:])] - nodes[part[0]]
    a, b, c, d = part
    return part if np.linalg.det(edges) > 0 else (a, b, d, c)


@njit(cache=True)
def _edges(cells, n, pairs):  # type: ignore[no-untyped-def]
    """Edges by their smaller node: starts (n + 1,), larger nodes (e,), ascending in each bucket."""
    starts = np.zeros(n + 1, dtype=np.int64)
    for e in range(cells.shape[0]):
        for a, b in pairs:
            starts[min(cells[e, a], cells[e, b]) + 1] += 1
    starts = np.cumsum(starts)
    place, found = starts[:-1].copy(), np.empty(starts[-1], dtype=np.int32)
    for e in range(cells.shape[0]):
        for a, b in pairs:
            low = min(cells[e, a], cells[e, b])
            found[place[low]] = max(cells[e, a], cells[e, b])
            place[low] += 1
    unique, count = np.zeros(n + 1, dtype=np.int64), 0
    for node in range(n):
        bucket = np.sort(found[starts[node] : starts[node + 1]])
        for i in range(bucket.size):
            if i == 0 or bucket[i] != bucket[i - 1]:
                found[count] = bucket[i]  # never ahead of the bucket that is read
                count += 1
        unique[node + 1] = count
    return unique, found[:count].copy()


@njit(cache=True)
def _split(points, cells, n, starts, ends, pairs, children):  # type: ignore[no-untyped-def]
    """(8 m, 4) the parts of each cell, one cell after the other."""
    out, local = np.empty((8 * cells.shape[0], 4), dtype=np.int32), np.empty(10, dtype=np.int32)
    for e in range(cells.shape[0]):
        local[:4] = cells[e]
        for i in range(6):
            a, b = cells[e, pairs[i, 0]], cells[e, pairs[i, 1]]
            low, high = min(a, b), max(a, b)
            bucket = ends[starts[low] : starts[low + 1]]
            local[4 + i] = n + starts[low] + np.searchsorted(bucket, high)
        lengths = np.empty(3)
        for k in range(3):
            lengths[k] = np.sum((points[local[4 + k]] - points[local[9 - k]]) ** 2)
        parts = children[np.argmin(lengths)]
        for j in range(8):
            for k in range(4):
                out[8 * e + j, k] = local[parts[j, k]]
    return out
