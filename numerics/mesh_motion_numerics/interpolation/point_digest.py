"""A digest of the positions of many nodes: the key of cached results for them.

Two states with the same digest have the same bits, except for a negligible probability: all threads hash blocks of
coordinates, each in four lanes of multiplications and rotations (the round of xxHash), and SHA-256 hashes the 256 bits
of all blocks. This is one pass over the coordinates at memory speed; SHA-256 over all of them would take ten times as
long.
"""

import hashlib

import mesh_motion_kernels as kernels
import numpy as np

from mesh_motion_numerics.arrays import Floats

__all__ = ["point_digest"]


def point_digest(points: Floats) -> bytes:
    """32 bytes that identify the shape and the bits of points (n, d)."""
    lanes = kernels.hash_blocks(np.ascontiguousarray(points).reshape(-1).view(np.uint64))
    return hashlib.sha256(repr(points.shape).encode() + lanes.tobytes()).digest()
