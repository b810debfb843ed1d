"""The canonical order of nodes: along the Morton (Z-order) curve of their reference coordinates.

The order depends on the coordinates and global ids alone, not on who sent which node: a mesh in one partition or in
many becomes the same arrays, hence bitwise the same answers. Near nodes are near in memory, which the evaluation
kernels need.
"""

import numpy as np

from mesh_motion_server.numerics.arrays import Floats, Integers
from mesh_motion_server.numerics.mesh.morton import morton_codes

__all__ = ["canonical_order"]


def canonical_order(points: Floats, global_ids: Integers) -> Integers:
    """(n,) indices that sort nodes by Morton code, ties by global id.

    Parameters
    ----------
    points : (n, d) array
        Reference coordinates, mesh length unit.
    global_ids : (n,) int64 array
        Each once.
    """
    return np.lexsort((global_ids, morton_codes(points)))
