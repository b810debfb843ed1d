"""Groups of neighbours: runs of equal length along the Morton curve, each inside a ball."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mesh_motion_numerics.mesh.morton import morton_codes
from numpy.typing import NDArray

__all__ = ["Groups", "group_cells", "group_points"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Groups:
    """Every item in one group.

    Attributes
    ----------
    order : (m,) int64 array
        Items sorted by group.
    starts : (g + 1,) int64 array
        Group k holds ``order[starts[k]:starts[k + 1]]``.
    centres : (g, d) array, mesh length unit
    radii : (g,) array, mesh length unit
        A ball of this radius about the centre contains all of the group's items.
    """

    order: Ints
    starts: Ints
    centres: Floats
    radii: Floats

    def __len__(self) -> int:
        return len(self.radii)

    @property
    def group_of(self) -> Ints:
        """(m,) group number of each item."""
        out = np.empty(len(self.order), dtype=np.int64)
        out[self.order] = np.repeat(np.arange(len(self)), np.diff(self.starts))
        return out


def group_points(points: Floats, size: int) -> Groups:
    """Groups of ``size`` (the last may be smaller) of points (m, d)."""
    return group_cells(points, [np.arange(len(points))[:, None]], size)


def group_cells(points: Floats, blocks: Sequence[NDArray[np.integer]], size: int) -> Groups:
    """Groups of cells, given as blocks of node numbers (m_b, n_b) at points (n, d); balls contain whole cells."""
    order = np.argsort(morton_codes(np.concatenate([points[nodes].mean(axis=1) for nodes in blocks])), kind="stable")
    starts = np.append(np.arange(0, len(order), size), len(order)).astype(np.int64)
    low = np.concatenate([points[nodes].min(axis=1) for nodes in blocks])[order]
    high = np.concatenate([points[nodes].max(axis=1) for nodes in blocks])[order]
    middles = 0.5 * (np.minimum.reduceat(low, starts[:-1]) + np.maximum.reduceat(high, starts[:-1]))
    group = np.empty(len(order), dtype=np.int64)
    group[order] = np.repeat(np.arange(len(middles)), np.diff(starts))
    furthest, first = np.empty(len(order)), 0
    for nodes in blocks:
        rows = slice(first, first + len(nodes))
        away = points[nodes] - middles[group[rows], None]
        furthest[rows] = np.sqrt(np.sum(away**2, axis=2).max(axis=1))
        first += len(nodes)
    return Groups(order, starts, middles, np.maximum.reduceat(furthest[order], starts[:-1]))
