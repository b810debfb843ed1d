"""Cells in the lexicographic order of their nodes: one bucket for each first node, each sorted by the other nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

__all__ = ["first_repetition", "sorted_cells"]

Ints = NDArray[np.int64]


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
    width = np.int32 if nodes <= 2**31 else np.int64
    given = [
        (np.ascontiguousarray(new, dtype=np.int64), np.ascontiguousarray(cells, dtype=width)) for new, cells in pieces
    ]
    total = sum(len(cells) for _, cells in given)
    rows = np.empty((total, given[0][1].shape[1]), dtype=np.int64)
    # kept as long as the session: half the memory where the numbers allow it
    order = np.empty(total, dtype=np.int32 if total < 2**31 else np.int64)
    kernels.sort_cells(given, nodes, rows, order)
    return rows, order


def first_repetition(rows: Ints) -> int | None:
    """The first of sorted rows (m, k) that equals the one before it."""
    same = np.flatnonzero(rows[1:, -1] == rows[:-1, -1])  # few neighbours agree in this column, most in the first
    same = same[(rows[same + 1] == rows[same]).all(axis=1)]
    return int(same[0]) + 1 if len(same) else None
