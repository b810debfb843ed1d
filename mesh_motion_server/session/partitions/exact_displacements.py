"""Displacements and the resulting coordinates: of the boundary in a request, of all nodes in a reply.

The arrays are as large as the mesh, so each is written once or, if only few numbers change, in place. There are no
sums, so the results are the same for any number of threads.
"""

import mesh_motion_kernels as kernels
import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers


def settle(moved: Floats, base: Floats, nodes: Integers, displacement: Floats) -> bool:
    """Change ``moved`` to ``base`` plus the rounded difference ``moved - base``; return whether nothing changed.

    Parameters
    ----------
    moved, base : (n, d) arrays, mesh length unit
        C-contiguous.
    nodes : (k,) int64 array
        Nodes whose ``displacement`` (k, d) is given, mesh length unit.
    """
    before = moved.take(nodes, axis=0)
    changed = kernels.round_differences(moved.reshape(-1), base.reshape(-1))
    elsewhere = changed - int(np.count_nonzero(moved.take(nodes, axis=0) != before))
    prescribed = base.take(nodes, axis=0) + displacement
    moved[nodes] = prescribed
    return elsewhere == 0 and bool(np.array_equal(prescribed, before))


def differences_of(moved: Floats, base: Floats, rows: Integers) -> Floats:
    """``moved - base`` (r, d) of the ``rows`` (r,) of two (n, d) arrays."""
    found = np.empty((len(rows), base.shape[1]))
    kernels.take_differences(moved, base, rows, found)
    return found
