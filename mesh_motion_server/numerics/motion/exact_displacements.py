"""The displacements that lead from given coordinates to a motion's, and the coordinates that they lead to.

All of it is as large as the mesh, so an array is written once or, where only few numbers change, in place; nothing is
summed, and the results are the same for any number of threads.
"""

from __future__ import annotations

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

__all__ = ["differences_of", "settle"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


def settle(moved: Floats, base: Floats, nodes: Indices, told: Floats) -> bool:
    """Change ``moved`` into ``base`` plus its rounded differences to it; return whether that changed nothing.

    Parameters
    ----------
    moved, base : (n, d) arrays, mesh length unit
        C-contiguous.
    nodes : (k,) int64 array
        Those whose displacement is ``told`` (k, d) instead, mesh length unit.
    """
    before = moved[nodes]
    changed = kernels.round_differences(moved.reshape(-1), base.reshape(-1))
    elsewhere = changed - int(np.count_nonzero(moved[nodes] != before))
    moved[nodes] = base[nodes] + told
    return elsewhere == 0 and bool(np.array_equal(moved[nodes], before))


def differences_of(moved: Floats, base: Floats, rows: Indices) -> Floats:
    """``moved - base`` (r, d) of the ``rows`` (r,) of two (n, d) arrays."""
    found = np.empty((len(rows), base.shape[1]))
    kernels.take_differences(moved, base, rows, found)
    return found
