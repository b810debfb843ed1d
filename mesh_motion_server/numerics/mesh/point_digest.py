"""A name for the positions of many nodes: what was worked out for them is found again by it.

Two states with the same name have the same bits, for all that chance can do: blocks of coordinates are hashed on all
threads by four lanes of multiplications and rotations each (the round of xxHash), and their 256 bits each by SHA-256.
A pass over the coordinates at the speed of memory; SHA-256 over all of them would take ten times as long.
"""

from __future__ import annotations

import hashlib

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

__all__ = ["point_digest"]


def point_digest(points: NDArray[np.float64]) -> bytes:
    """32 bytes that name the shape and the bits of points (n, d)."""
    lanes = kernels.hash_blocks(np.ascontiguousarray(points).reshape(-1).view(np.uint64))
    return hashlib.sha256(repr(points.shape).encode() + lanes.tobytes()).digest()
