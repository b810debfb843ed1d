"""Frame 0: a msgpack map that is packed plainly and unpacked strictly.

msgpack leaves several points open; they are fixed here as in SPEC.md: text keys only, no key twice, no extension types,
valid UTF-8, one object and no bytes after it. Limits on size, items and depth are checked before memory is allocated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import msgpack
import numpy as np

from mesh_motion_protocol.errors import ProtocolError
from mesh_motion_protocol.limits import CONTAINER_ITEMS, HEADER_BYTES, HEADER_DEPTH

__all__ = ["pack", "plain", "unpack"]

_OTHER, _TEXT, _ARRAY, _MAP = range(4)
#: Kind of a value by its first byte, as msgpack defines it.
_KINDS = bytes(
    _MAP if byte >> 4 == 0x8 or byte in (0xDE, 0xDF)
    else _ARRAY if byte >> 4 == 0x9 or byte in (0xDC, 0xDD)
    else _TEXT if byte >> 5 == 0b101 or byte in (0xD9, 0xDA, 0xDB)
    else _OTHER
    for byte in range(256)
)  # fmt: skip

#: Types of most values: they are checked before slower cases.
_LEAVES = frozenset({float, str, int, bool, bytes, type(None)})


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
    # Unpacker copies the frame; with this read_size it allocates no more than the frame
    reader = msgpack.Unpacker(
        None, read_size=len(frame), max_buffer_size=HEADER_BYTES, raw=False, ext_hook=_no_extension, max_ext_len=0
    )
    try:
        reader.feed(frame)
        header = _value(reader, frame, 1)
    except ProtocolError:
        raise
    except IndexError:
        raise _malformed(f"frame 0 is not one msgpack map: it ends after {len(frame)} bytes") from None
    except (ValueError, msgpack.UnpackException) as error:
        raise _malformed(f"frame 0 is not one msgpack map within the limits: {type(error).__name__}: {error}") from None
    if reader.tell() != len(frame):
        raise _malformed(f"frame 0 is one msgpack map, got {len(frame) - reader.tell()} bytes behind it")
    if not isinstance(header, dict):
        raise _malformed(f"frame 0 must be a msgpack map, got {type(header).__name__}")
    return header


def plain(value: Any) -> Any:
    """Turn numpy scalars and tuples inside ``value`` into types that msgpack knows."""
    if type(value) in _LEAVES:
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value


def _value(reader: msgpack.Unpacker, frame: bytes | memoryview, depth: int) -> Any:
    """Read the next value; ``depth`` is the nesting level of a map or an array in this place."""
    kind = _KINDS[frame[reader.tell()]]
    if kind == _MAP:
        return _map(reader, frame, depth)
    if kind == _ARRAY:
        items = _admitted(reader.read_array_header(), depth, _malformed)
        return [_value(reader, frame, depth + 1) for _ in range(items)]
    return reader.unpack()


def _map(reader: msgpack.Unpacker, frame: bytes | memoryview, depth: int) -> dict[str, Any]:
    """Read a map, key by key.

    ``unpackb`` interns keys, and Python 3.12.0 to 3.12.6 and builds without the global lock never free an interned
    string: a client that always sends new keys would fill the server's memory.
    """
    mapping: dict[str, Any] = {}
    for _ in range(_admitted(reader.read_map_header(), depth, _malformed)):
        if _KINDS[frame[reader.tell()]] != _TEXT:
            raise _malformed(f"map keys must be text, got one with the first byte 0x{frame[reader.tell()]:02x}")
        key = reader.unpack()
        if key in mapping:  # two readers could see two different messages
            raise _malformed(f"the key {key!r} comes twice")
        mapping[key] = _value(reader, frame, depth + 1)
    return mapping


def _admitted(items: int, depth: int, too_many: Callable[[str], ProtocolError]) -> int:
    """Check the number of items of a map or array, and its depth; when reading, before any item is made."""
    if depth > HEADER_DEPTH:
        raise _malformed(f"the header must be nested at most {HEADER_DEPTH} deep")
    if items > CONTAINER_ITEMS:
        raise too_many(f"a map or array in the header must have at most {CONTAINER_ITEMS} items, got {items}")
    return items


def _no_extension(code: int, _data: bytes) -> Any:
    raise _malformed(f"msgpack extension types are not admitted, got type {code}")


def _check_containers(value: Any, depth: int = 1) -> None:
    """Check depth and number of items of nested maps and arrays."""
    if type(value) in _LEAVES or not isinstance(value, (Mapping, list)):
        return
    _admitted(len(value), depth, _too_large)
    for item in value.values() if isinstance(value, Mapping) else value:
        _check_containers(item, depth + 1)


def _malformed(message: str) -> ProtocolError:
    return ProtocolError(message, code="INVALID_ARGUMENT.HEADER")


def _too_large(message: str) -> ProtocolError:
    return ProtocolError(message, code="RESOURCE_EXHAUSTED.BYTES")
