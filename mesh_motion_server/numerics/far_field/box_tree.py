"""A tree of boxes over points: sorted along the Morton curve and cut where its leading bits change.

A box is the bounding box of its own points, not a cell of a grid: surfaces fill little of their cells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mesh_motion_server.numerics.centres import padded
from mesh_motion_server.numerics.morton import morton_codes

__all__ = ["BoxTree"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Bits of a Morton code that are looked at, a multiple of every dimension.
_BITS = 60


@dataclass(frozen=True, eq=False)
class BoxTree:
    """Boxes, parents before their children, those of one parent side by side.

    Attributes
    ----------
    order : (n,) int64 array
        Sorted point ``i`` is point ``order[i]``.
    points : (n, 3) array, mesh length unit
        Sorted.
    parent : (b,) int64 array
        −1 for the root, which is box 0.
    points_of : (b, 2) int64 array
        First sorted point of each box and one past its last.
    children_of : (b, 2) int64 array
        First child and one past the last; both equal for a leaf.
    levels : (l + 1,) int64 array
        First box of each level, and the number of boxes.
    low, high : (b, 3) arrays, mesh length unit
    """

    order: Indices
    points: Floats
    parent: Indices
    points_of: Indices
    children_of: Indices
    levels: Indices
    low: Floats
    high: Floats

    @classmethod
    def build(cls, points: Floats, *, leaf: int) -> BoxTree:
        """The tree of points (n ≥ 1, d); boxes of more than ``leaf`` distinct points are cut."""
        d = points.shape[1]
        codes = morton_codes(points).astype(np.int64)
        if d == 1:
            codes <<= _BITS - 52
        elif d == 2:
            codes >>= 2
        else:
            codes >>= 3
        order = np.argsort(codes, kind="stable")
        parent, points_of, children_of, levels = _cut(codes[order], d, leaf)
        arranged = padded(points)[order]
        low, high = _bounds(arranged, points_of, children_of)
        return cls(order, arranged, parent, points_of, children_of, levels, low, high)

    @property
    def n_boxes(self) -> int:
        return len(self.parent)

    @property
    def leaves(self) -> Indices:
        """(l,) boxes without children."""
        return np.flatnonzero(self.children_of[:, 0] == self.children_of[:, 1])


@njit(cache=True, error_model="numpy")
def _first_from(codes: Indices, first: int, last: int, least: int) -> int:
    """First of the sorted codes[first:last] that is at least ``least``; ``last`` if none is."""
    while first < last:
        middle = (first + last) // 2
        if codes[middle] < least:
            first = middle + 1
        else:
            last = middle
    return first


@njit(cache=True, error_model="numpy")
def _cut(codes: Indices, d: int, leaf: int) -> tuple[Indices, Indices, Indices, Indices]:
    """Parents, points, children and levels of the boxes of sorted codes (n,), d bits a level."""
    most = 1 + 2 * codes.size  # every box that is cut has two children at least
    parent = np.empty(most, dtype=np.int64)
    points_of, children_of = np.empty((most, 2), dtype=np.int64), np.empty((most, 2), dtype=np.int64)
    parent[0], points_of[0, 0], points_of[0, 1] = -1, 0, codes.size
    levels = np.zeros(_BITS + 2, dtype=np.int64)
    n, at, level = 1, 0, 0
    while at < n:
        level += 1
        end = n
        levels[level] = end
        for box in range(at, end):
            first, last = points_of[box]
            children_of[box, 0] = n
            shared = codes[first] ^ codes[last - 1]
            if last - first > leaf and shared != 0:
                shift = 0
                while shared >> (shift + d):
                    shift += d
                while first < last:
                    digit = codes[first] >> shift
                    split = _first_from(codes, first, last, (digit + 1) << shift)
                    parent[n], points_of[n, 0], points_of[n, 1] = box, first, split
                    n += 1
                    first = split
            children_of[box, 1] = n
        at = end
    return parent[:n].copy(), points_of[:n].copy(), children_of[:n].copy(), levels[: level + 1].copy()


@njit(cache=True, error_model="numpy")
def _bounds(points: Floats, points_of: Indices, children_of: Indices) -> tuple[Floats, Floats]:
    """(b, 3) lower and upper corners of the boxes, of children first."""
    n = len(points_of)
    low, high = np.full((n, 3), np.inf), np.full((n, 3), -np.inf)
    for box in range(n - 1, -1, -1):
        if children_of[box, 0] == children_of[box, 1]:
            for i in range(points_of[box, 0], points_of[box, 1]):
                for m in range(3):
                    low[box, m] = min(low[box, m], points[i, m])
                    high[box, m] = max(high[box, m], points[i, m])
        for child in range(children_of[box, 0], children_of[box, 1]):
            for m in range(3):
                low[box, m] = min(low[box, m], low[child, m])
                high[box, m] = max(high[box, m], high[child, m])
    return low, high
