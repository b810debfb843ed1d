"""Two digests: of a request's content, which distinguishes a repeat from a conflict, and of a committed state.

These fields do not belong to the content of a request: the epoch (its sender may have resumed the session in between),
the memory for the reply, the limit of computing, the end of the run, and the request id.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from mesh_motion_protocol.arrays import frames_of
from mesh_motion_protocol.header import pack
from mesh_motion_protocol.messages import Message
from mesh_motion_protocol.schema import schema_of, sent_fields

__all__ = ["request_digest", "state_digest"]

#: Begins the hashed text, so that the digest of a state cannot equal another kind of digest.
STATE_PREFIX = b"mesh-motion state 1\n"

_NO_CONTENT = frozenset({"epoch", "memory", "compute_limit_ms", "final_step"})
#: Number of rows that are widened at a time, so that they stay in the cache.
_ROWS = 1 << 14


def request_digest(message: Message) -> bytes:
    """32 bytes: SHA-256 over the type and all fields, except ids and fields that are not content.

    Arrays are compared by value: narrow ones are widened before hashing, some rows at a time.

    Raises
    ------
    ProtocolError
        For a value that the wire does not know, as :func:`.header.pack` does.
    """
    schema = schema_of(type(message))
    values = sent_fields(message, [spec for spec in schema.fields if spec.name not in _NO_CONTENT])
    try:
        packed = msgpack.packb([schema.kind, _sorted(values)])
    except (TypeError, ValueError, OverflowError):
        pack(values)  # raises an error for a value that the wire does not know
        raise
    digest = hashlib.sha256(packed)
    for spec in schema.arrays:
        array = getattr(message, spec.name)
        if array is None:
            digest.update(b"\0")
            continue
        wide = np.dtype(f"<{array.dtype.kind}8") if array.dtype.kind in "fi" else array.dtype
        digest.update(msgpack.packb([spec.name, wide.str, [int(length) for length in array.shape]]))
        for block in _blocks(array, wide):
            digest.update(block)
    return digest.digest()


def state_digest(step: int, points: NDArray[np.float64]) -> bytes:
    """SHA-256 of a committed state.

    Parameters
    ----------
    step : int
        The committed step.
    points : (n, d) array, mesh length unit
        Committed coordinates, ascending by global id (with one partition: in the order of the upload).

    Notes
    -----
    Hashed are, in this order: the 20 bytes ``mesh-motion state 1\\n``; step, n and d as <i8; the coordinates as <f8,
    row by row.
    """
    digest = hashlib.sha256(STATE_PREFIX)
    digest.update(np.array([step, *points.shape], dtype="<i8").tobytes())
    for frame in frames_of(np.asarray(points, dtype="<f8")):
        digest.update(frame)
    return digest.digest()


def _blocks(array: NDArray[Any], dtype: np.dtype[Any]) -> Iterator[memoryview]:
    rows = np.atleast_1d(array)
    for start in range(0, len(rows) if rows.size else 0, _ROWS):  # 2⁴⁷ rows without columns must not take time
        yield np.ascontiguousarray(rows[start : start + _ROWS], dtype=dtype).data


def _sorted(value: Any) -> Any:
    """Sort maps by their keys, at every level."""
    if isinstance(value, dict):
        return {key: _sorted(value[key]) for key in sorted(value)}
    return [_sorted(item) for item in value] if isinstance(value, list) else value
