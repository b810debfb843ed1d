"""The displacements that lead from given coordinates to a motion's, and the coordinates that they lead to.

All of it is as large as the mesh, so an array is written once or, where only few numbers change, in place; nothing is
summed, and the results are the same for any number of threads.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.numerics.thread_share import threads_for

__all__ = ["differences_of", "settle"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_PARTS = 64
#: Numbers that a thread does in the time that it takes to wake it up.
_NUMBERS_PER_THREAD = 100_000


def settle(moved: Floats, base: Floats, nodes: Indices, told: Floats) -> bool:
    """Change ``moved`` into ``base`` plus its rounded differences to it; return whether that changed nothing.

    Parameters
    ----------
    moved, base : (n, d) arrays, mesh length unit
        C-contiguous.
    nodes : (k,) int64 array
        Those whose displacement is ``told`` (k, d) instead, mesh length unit.
    """
    before, differing = moved[nodes], np.zeros(_PARTS, dtype=np.int64)
    with threads_for(moved.size // _NUMBERS_PER_THREAD):
        _round_differences(moved.reshape(-1), base.reshape(-1), differing)
    elsewhere = int(differing.sum()) - int(np.count_nonzero(moved[nodes] != before))
    moved[nodes] = base[nodes] + told
    return elsewhere == 0 and bool(np.array_equal(moved[nodes], before))


def differences_of(moved: Floats, base: Floats, rows: Indices) -> Floats:
    """``moved - base`` (r, d) of the ``rows`` (r,) of two (n, d) arrays."""
    found = np.empty((len(rows), base.shape[1]))
    with threads_for(found.size // _NUMBERS_PER_THREAD):
        _take_differences(moved, base, rows, found)
    return found


@njit(cache=True, parallel=True)
def _round_differences(moved, base, differing):  # type: ignore[no-untyped-def]
    """Entry by entry; how many of each part's change."""
    m = moved.size
    for part in prange(_PARTS):
        count = 0
        for k in range(part * m // _PARTS, (part + 1) * m // _PARTS):
            value = base[k] + (moved[k] - base[k])
            if value != moved[k]:
                moved[k] = value
                count += 1
        differing[part] = count


@njit(cache=True, parallel=True)
def _take_differences(moved, base, rows, found):  # type: ignore[no-untyped-def]
    m, d = found.shape
    for part in prange(_PARTS):
        for j in range(part * m // _PARTS, (part + 1) * m // _PARTS):
            i = rows[j]
            for c in range(d):
                found[j, c] = moved[i, c] - base[i, c]
