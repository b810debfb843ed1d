"""A name for the positions of many nodes: what was worked out for them is found again by it.

Two states with the same name have the same bits, for all that chance can do: blocks of coordinates are hashed on all
threads by four lanes of multiplications and rotations each (the round of xxHash), and their 256 bits each by SHA-256.
A pass over the coordinates at the speed of memory; SHA-256 over all of them would take ten times as long.

References
----------
Y. Collet, xxHash, XXH64: https://github.com/Cyan4973/xxHash/blob/dev/doc/xxhash_spec.md
"""

from __future__ import annotations

import hashlib

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.numerics.read_only import read_only
from mesh_motion_server.numerics.threads import threads_for

__all__ = ["point_digest"]

_BLOCK = 8192  # numbers of one task
_FIRST, _SECOND = np.uint64(0x9E3779B185EBCA87), np.uint64(0xC2B2AE3D27D4EB4F)
_LEFT, _RIGHT = np.uint64(31), np.uint64(33)


def point_digest(points: NDArray[np.float64]) -> bytes:
    """32 bytes that name the shape and the bits of points (n, d)."""
    words = read_only(points).reshape(-1).view(np.uint64)
    lanes = np.empty(((words.size + _BLOCK - 1) // _BLOCK, 4), dtype=np.uint64)
    with threads_for(float(words.size)):
        _hash_blocks(words, lanes)
    return hashlib.sha256(repr(points.shape).encode() + lanes.tobytes()).digest()


@njit(cache=True, error_model="numpy", inline="always")
def _round(lane, word):  # type: ignore[no-untyped-def]
    mixed = lane + word * _SECOND
    return ((mixed << _LEFT) | (mixed >> _RIGHT)) * _FIRST


@njit(cache=True, error_model="numpy", parallel=True)
def _hash_blocks(words: NDArray[np.uint64], lanes: NDArray[np.uint64]) -> None:
    """Fill ``lanes`` (blocks, 4); a last block's missing words count as none."""
    for block in prange(lanes.shape[0]):
        first = block * _BLOCK
        last = min(words.size, first + _BLOCK)
        a, b, c, d = np.uint64(last - first), np.uint64(1), np.uint64(2), np.uint64(3)
        whole = first + (last - first) // 4 * 4
        for i in range(first, whole, 4):
            a, b = _round(a, words[i]), _round(b, words[i + 1])
            c, d = _round(c, words[i + 2]), _round(d, words[i + 3])
        for i in range(whole, last):
            a = _round(a, words[i])
        lanes[block, 0], lanes[block, 1], lanes[block, 2], lanes[block, 3] = a, b, c, d
