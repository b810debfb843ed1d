"""Cells in the lexicographic order of their nodes: one bucket for each first node, each sorted by the other nodes."""

from collections.abc import Sequence
from typing import Any

import mesh_motion_kernels as kernels
import numpy as np
from mesh_motion_numerics.arrays import Integers, Shorts
from numpy.typing import NDArray

__all__ = ["sorted_cells"]


def sorted_cells(pieces: Sequence[tuple[Integers, Integers]], nodes: int) -> tuple[Shorts, NDArray[Any], int]:
    """Cells of one type, renumbered and sorted.

    Parameters
    ----------
    pieces : sequence of (node map, cells)
        New number of each node of the cells (m_i, k), and these cells; every number is in range.
    nodes : int
        Upper bound: all new numbers are smaller.

    Returns
    -------
    (m, k) int32 array
        Rows ascending; equal rows in the input order.
    (m,) int32 or int64 array
        Input row of each row, counted through the pieces.
    int
        The first row that equals the one before it, or -1.
    """
    given = [
        (np.ascontiguousarray(new, dtype=np.int64), np.ascontiguousarray(cells, dtype=np.int32))
        for new, cells in pieces
    ]
    total = sum(len(cells) for _, cells in given)
    rows = np.empty((total, given[0][1].shape[1]), dtype=np.int32)
    # kept as long as the session: int32, if possible, takes half the memory
    order = np.empty(total, dtype=np.int32 if total < 2**31 else np.int64)
    return rows, order, kernels.sort_cells(given, nodes, rows, order)
