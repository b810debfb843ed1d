"""Each tetrahedron is split into eight of half the size: four at the corners, four from the remaining octahedron.

New nodes lie at the midpoints of the edges, so that a flat boundary stays flat. The octahedron is cut along its
shortest diagonal, so that the cells' shapes do not get worse with every refinement (Bey 1995 chooses the diagonal by
number). Edges are sorted numbers, smaller node · n + larger node, so that no array is larger than the new mesh.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["refined_tetrahedra"]

Floats = NDArray[np.float64]
Rows = NDArray[np.int32]

#: Corners of each edge; the midpoint of edge i is local node 4 + i.
_EDGES = np.array([(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)])
_CORNERS = ((0, 4, 5, 6), (4, 1, 7, 8), (5, 7, 2, 9), (6, 8, 9, 3))
#: The octahedron's diagonals, each with the four other midpoints going round it.
_DIAGONALS = (((4, 9), (5, 7, 8, 6)), ((5, 8), (4, 7, 9, 6)), ((6, 7), (4, 8, 9, 5)))
#: Cells that are split at a time.
_CHUNK = 65536


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
    n, cells = len(points), np.asarray(cells, dtype=np.int32)
    edges = _edges(cells, n)
    refined = np.concatenate([points, (points[edges // n] + points[edges % n]) / 2])
    parts, children = np.empty((len(cells), 8, 4), dtype=np.int32), _children()
    for first in range(0, len(cells), _CHUNK):
        part = cells[first : first + _CHUNK]
        local = np.hstack([part, n + np.searchsorted(edges, _numbers(part, n))])
        lengths = ((refined[local[:, 4:7]] - refined[local[:, 9:6:-1]]) ** 2).sum(axis=2)
        taken = children[lengths.argmin(axis=1)]
        parts[first : first + _CHUNK] = np.take_along_axis(local[:, None], taken, axis=2)
    return refined, parts.reshape(-1, 4)


def _numbers(cells: Rows, n: int) -> NDArray[np.int64]:
    """(m, 6) number of each edge of each cell; equal edges have equal numbers."""
    corners = cells[:, _EDGES]
    return corners.min(axis=2).astype(np.int64) * n + corners.max(axis=2)


def _edges(cells: Rows, n: int) -> NDArray[np.int64]:
    """(e,) numbers of all edges, ascending."""
    numbers = np.empty((len(cells), 6), dtype=np.int64)
    for first in range(0, len(cells), _CHUNK):
        numbers[first : first + _CHUNK] = _numbers(cells[first : first + _CHUNK], n)
    found = numbers.ravel()
    found.sort()
    return found[np.diff(found, prepend=-1) > 0]


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
    """The part, with two nodes swapped if its volume was negative."""
    edges = nodes[list(part[1:])] - nodes[part[0]]
    a, b, c, d = part
    return part if np.linalg.det(edges) > 0 else (a, b, d, c)
