"""A tree of boxes over points: sorted along the Morton curve and cut where its leading bits change.

A box is the bounding box of its own points, not a cell of a grid: surfaces fill little of their cells.
"""

from __future__ import annotations

from dataclasses import dataclass

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.mesh.morton import morton_codes
from mesh_motion_server.numerics.mesh.points import padded

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
        arranged = padded(points)[order]
        return cls(order, arranged, *kernels.build_box_tree(codes[order], arranged, d, leaf))

    @property
    def n_boxes(self) -> int:
        return len(self.parent)

    @property
    def leaves(self) -> Indices:
        """(l,) boxes without children."""
        return np.flatnonzero(self.children_of[:, 0] == self.children_of[:, 1])
