"""Frame 0: a msgpack map, packed plainly and unpacked strictly.

What msgpack leaves open is pinned here as SPEC.md pins it: text keys only, no key twice, no extension types, valid
UTF-8, one object and nothing behind it, and limits on size, items and depth that hold before anything is allocated.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgpack
import numpy as np

from mesh_motion_protocol.errors import ProtocolError
from mesh_motion_protocol.limits import CONTAINER_ITEMS, HEADER_BYTES, HEADER_DEPTH

__all__ = ["pack", "plain", "unpack"]


def pack(header: Mapping[str, Any]) -> bytes:
    """Pack a map of plain values.

    Raises
    ------
    ProtocolError
        RESOURCE_EXHAUSTED.BYTES beyond the header's size, depth or items; INVALID_ARGUMENT.HEADER for a value that the
        wire does not know.
    """
    _check_containers(header)
    try:
        packed: bytes = msgpack.packb(header, use_bin_type=True)
    except (TypeError, ValueError, OverflowError) as error:
        raise _malformed(f"the header cannot be packed: {error}") from None
    if len(packed) > HEADER_BYTES:
        raise _too_large(f"the header must be at most {HEADER_BYTES} bytes, got {len(packed)}")
    return packed


def unpack(frame: bytes | memoryview) -> dict[str, Any]:
    """Unpack frame 0.

    Raises
    ------
    ProtocolError
        RESOURCE_EXHAUSTED.BYTES beyond the header's size; INVALID_ARGUMENT.HEADER for everything else.
    """
    if len(frame) > HEADER_BYTES:
        raise _too_large(f"frame 0 must be at most {HEADER_BYTES} bytes, got {len(frame)}")
    try:
        header = msgpack.unpackb(
            frame,
            raw=False,
            strict_map_key=True,
            object_pairs_hook=_unique,
            ext_hook=_no_extension,
            max_array_len=CONTAINER_ITEMS,
            max_map_len=CONTAINER_ITEMS,
            max_ext_len=0,
        )
    except ProtocolError:
        raise
    except (ValueError, RecursionError, msgpack.UnpackException) as error:
        raise _malformed(f"frame 0 is not one msgpack map within the limits: {type(error).__name__}: {error}") from None
    if not isinstance(header, dict):
        raise _malformed(f"frame 0 must be a msgpack map, got {type(header).__name__}")
    _check_containers(header)
    return header


def plain(value: Any) -> Any:
    """Turn numpy scalars and tuples inside ``value`` into what msgpack knows."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value


def _unique(pairs: list[tuple[Any, Any]]) -> dict[str, Any]:
    """Pairs → dict; a key that comes twice would let two readers see two messages."""
    mapping: dict[str, Any] = {}
    for key, value in pairs:
        if not isinstance(key, str):
            raise _malformed(f"map keys must be text, got {type(key).__name__}")
        if key in mapping:
            raise _malformed(f"the key {key!r} comes twice")
        mapping[key] = value
    return mapping


def _no_extension(code: int, _data: bytes) -> Any:
    raise _malformed(f"msgpack extension types are not admitted, got type {code}")


def _check_containers(value: Any, depth: int = 1) -> None:
    """Depth and items of nested maps and arrays."""
    if not isinstance(value, (Mapping, list)):
        return
    if depth > HEADER_DEPTH:
        raise _malformed(f"the header must be nested at most {HEADER_DEPTH} deep")
    if len(value) > CONTAINER_ITEMS:
        raise _too_large(f"a map or array in the header must have at most {CONTAINER_ITEMS} items, got {len(value)}")
    for item in value.values() if isinstance(value, Mapping) else value:
        _check_containers(item, depth + 1)


def _malformed(message: str) -> ProtocolError:
    return ProtocolError(message, code="INVALID_ARGUMENT.HEADER")


def _too_large(message: str) -> ProtocolError:
    return ProtocolError(message, code="RESOURCE_EXHAUSTED.BYTES")
