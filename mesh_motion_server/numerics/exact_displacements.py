"""The displacements that lead from given coordinates to a motion's, and the coordinates that they lead to.

All of it is as large as the mesh, so each array is written once, without temporaries. Nothing is summed: the results
are the same for any number of threads.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.numerics.thread_share import threads_for

__all__ = ["differences_of", "reached_by_difference"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_PARTS = 64
#: Numbers that a thread does in the time that it takes to wake it up.
_NUMBERS_PER_THREAD = 100_000


def reached_by_difference(moved: Floats, base: Floats, nodes: Indices, told: Floats) -> tuple[Floats, bool]:
    """Where ``base`` plus the rounded differences to ``moved`` leads, and whether that is ``moved`` itself.

    Parameters
    ----------
    moved, base : (n, d) arrays, mesh length unit
        C-contiguous.
    nodes : (k,) int64 array
        Those whose displacement is ``told`` (k, d) instead, mesh length unit.
    """
    reached, differing = np.empty_like(base), np.zeros(_PARTS, dtype=np.int64)
    with threads_for(moved.size // _NUMBERS_PER_THREAD):
        _add_differences(moved.reshape(-1), base.reshape(-1), reached.reshape(-1), differing)
    wrong = int(differing.sum()) - int(np.count_nonzero(reached[nodes] != moved[nodes]))
    reached[nodes] = base[nodes] + told
    return reached, wrong == 0 and bool(np.array_equal(reached[nodes], moved[nodes]))


def differences_of(moved: Floats, base: Floats, rows: Indices) -> Floats:
    """``moved - base`` (r, d) of the ``rows`` (r,) of two (n, d) arrays."""
    found = np.empty((len(rows), base.shape[1]))
    with threads_for(found.size // _NUMBERS_PER_THREAD):
        _take_differences(moved, base, rows, found)
    return found


@njit(cache=True, parallel=True)
def _add_differences(moved, base, reached, differing):  # type: ignore[no-untyped-def]
    """Entry by entry; how many of each part's are not those of ``moved``."""
    m = moved.size
    for part in prange(_PARTS):
        count = 0
        for k in range(part * m // _PARTS, (part + 1) * m // _PARTS):
            value = base[k] + (moved[k] - base[k])
            reached[k] = value
            count += value != moved[k]
        differing[part] = count


@njit(cache=True, parallel=True)
def _take_differences(moved, base, rows, found):  # type: ignore[no-untyped-def]
    m, d = found.shape
    for part in prange(_PARTS):
        for j in range(part * m // _PARTS, (part + 1) * m // _PARTS):
            i = rows[j]
            for c in range(d):
                found[j, c] = moved[i, c] - base[i, c]
