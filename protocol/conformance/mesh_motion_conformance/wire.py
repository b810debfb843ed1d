"""Frames by sections 3 to 5 of SPEC.md, written independently of the implementation under test."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from mesh_motion_conformance.tables import tables

__all__ = ["CHUNK_BYTES", "HEADER_BYTES", "KEYS", "KINDS", "Malformed", "Message", "check_reply", "declaration",
           "frames_of", "pack", "read"]  # fmt: skip

Array = NDArray[Any]

KEYS = ("v", "type", "client", "sequence", "fields", "arrays")
HEADER_BYTES = 65_536
CHUNK_BYTES = 16_777_216
_ITEMS = 256
_DEPTH = 12
_BYTES = {"<f8": 8, "<f4": 4, "<i8": 8, "<i4": 4}
_WIDE = {"<f4": "<f8", "<i4": "<i8"}
_MISSING = object()
#: The types of Python that a field of each kind may have.
KINDS: dict[str, tuple[type, ...]] = {
    "str": (str,), "bin": (bytes,), "int": (int,), "float": (float, int), "bool": (bool,), "array": (list,),
    "map": (dict,),
}  # fmt: skip


class Malformed(Exception):
    """Frames that are not a message; ``section`` is the violated sentence."""

    def __init__(self, section: str, text: str) -> None:
        super().__init__(f"SPEC {section}: {text}")
        self.section = section


@dataclass
class Message:
    """A message as received; ``kind`` is ``type`` in the header, arrays are widened to 8 bytes an item."""

    kind: str
    client: bytes
    sequence: int
    fields: dict[str, Any]
    arrays: dict[str, Array] = field(default_factory=dict)
    frames: list[bytes] = field(default_factory=list)


def pack(value: Any) -> bytes:
    """msgpack by section 4: str and bin are different types."""
    packed: bytes = msgpack.packb(value, use_bin_type=True)
    return packed


def declaration(name: str, array: Array) -> dict[str, Any]:
    """An entry of ``arrays``."""
    return {"name": name, "dtype": array.dtype.newbyteorder("<").str, "shape": list(array.shape)}


def frames_of(array: Array) -> list[bytes]:
    """The bytes of an array, row by row, in chunks."""
    raw = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<")).tobytes()
    return [raw[start : start + CHUNK_BYTES] for start in range(0, len(raw), CHUNK_BYTES)]


def read(frames: Sequence[bytes]) -> Message:
    """A message from its frames, or :class:`Malformed` with the violated sentence of SPEC.md."""
    if not frames or len(frames[0]) > HEADER_BYTES:
        raise Malformed("6", f"frame 0 must have 1 … {HEADER_BYTES} bytes")
    header = _unpack(frames[0])
    _check_header(header)
    arrays = _arrays(header["arrays"], frames[1:])
    return Message(header["type"], header["client"], header["sequence"], header["fields"], arrays, list(frames))


def _unpack(frame: bytes) -> Any:
    """One msgpack map with str keys, each once, without extensions, and with nothing after it."""
    try:
        header = msgpack.unpackb(frame, raw=False, strict_map_key=False, object_pairs_hook=_pairs, ext_hook=_extension)
    except msgpack.ExtraData:
        raise Malformed("4.8", "bytes follow the map in frame 0") from None
    except (ValueError, msgpack.UnpackException) as error:
        raise Malformed("4", f"frame 0 is not msgpack: {error}") from None
    _check_containers(header, 1)
    return header


def _pairs(pairs: list[tuple[Any, Any]]) -> dict[str, Any]:
    keys = [key for key, _ in pairs]
    if any(type(key) is not str for key in keys) or len(set(keys)) < len(keys):
        raise Malformed("4.1", f"keys must be str and come once, got {keys}")
    return dict(pairs)


def _extension(code: int, _: bytes) -> Any:
    raise Malformed("4.3", f"extension types must not occur, got type {code}")


def _check_containers(value: Any, level: int) -> None:
    if isinstance(value, (dict, list)):
        if level > _DEPTH or len(value) > _ITEMS:
            raise Malformed("4.9", f"at most {_DEPTH} levels and {_ITEMS} items, got level {level}, {len(value)} items")
        for item in value.values() if isinstance(value, dict) else value:
            _check_containers(item, level + 1)


def _check_header(header: Any) -> None:
    """The six keys and their types."""
    if not isinstance(header, dict) or set(header) != set(KEYS):
        raise Malformed("4", f"frame 0 must be a map with exactly the keys {', '.join(KEYS)}")
    wanted = {"v": int, "type": str, "client": bytes, "sequence": int, "fields": dict, "arrays": list}
    for key, kind in wanted.items():
        if type(header[key]) is not kind:
            raise Malformed("4", f"{key} must be of type {kind.__name__}, got {header[key]!r:.60}")
    if header["v"] != 1 or len(header["client"]) != 16 or not 0 <= header["sequence"] < 2**63:
        raise Malformed("4", "v must be 1, client 16 bytes, sequence 0 … 2⁶³−1")


def _arrays(declared: list[Any], frames: Sequence[bytes]) -> dict[str, Array]:
    """The declared arrays from the frames after frame 0."""
    found: dict[str, Array] = {}
    at = 0
    for entry in declared:
        nbytes = _declared_bytes(entry)
        count = -(-nbytes // CHUNK_BYTES)
        chunks = frames[at : at + count]
        at += count
        if at > len(frames):
            raise Malformed("5.3", f"{entry['name']} needs {count} frames, got {len(chunks)}")
        sizes = [min(CHUNK_BYTES, nbytes - i * CHUNK_BYTES) for i in range(count)]
        if [len(chunk) for chunk in chunks] != sizes:
            raise Malformed("5.3", f"{entry['name']} needs frames of {sizes} bytes, got {[len(c) for c in chunks]}")
        if entry["name"] in found:
            raise Malformed("5", f"the array {entry['name']} comes twice")
        array = np.frombuffer(b"".join(chunks), dtype=entry["dtype"]).reshape(entry["shape"])
        found[entry["name"]] = array.astype(_WIDE.get(entry["dtype"], entry["dtype"]))
    if at != len(frames):
        raise Malformed("5.3", f"{at} frames are declared, got {len(frames)}")
    return found


def _declared_bytes(entry: Any) -> int:
    if not isinstance(entry, dict) or set(entry) != {"name", "dtype", "shape"} or type(entry["name"]) is not str:
        raise Malformed("5", f"an entry of arrays has exactly name, dtype, shape; got {entry!r:.80}")
    if type(entry["dtype"]) is not str or entry["dtype"] not in _BYTES:
        raise Malformed("5", f"the dtype of {entry['name']} must be one of {', '.join(_BYTES)}, got {entry['dtype']!r}")
    shape = entry["shape"]
    if type(shape) is not list or any(type(n) is not int or n < 0 for n in shape):
        raise Malformed("5", f"the shape of {entry['name']} must be an array of lengths, got {shape!r:.60}")
    return math.prod(shape) * _BYTES[entry["dtype"]]


def check_reply(message: Message) -> None:
    """Raise :class:`Malformed` if section 12 has other fields and arrays for a reply; unknown fields are ignored."""
    if message.kind not in tables().messages:
        raise Malformed("12", f"there is no message {message.kind!r}")
    for spec in tables().fields(message.kind):
        value = message.fields.get(spec.name, _MISSING)
        if value is _MISSING:
            if spec.required:
                raise Malformed("12", f"{message.kind} must have the field {spec.name}")
        elif spec.kind != "any" and type(value) not in KINDS[spec.kind]:
            raise Malformed("12", f"{message.kind}.{spec.name} must be {spec.kind}, got {value!r:.60}")
        elif "exactly" in spec.says and len(value) != spec.says["exactly"]:
            raise Malformed("12", f"{message.kind}.{spec.name} must have {spec.says['exactly']} bytes")
    _check_arrays(message)


def _check_arrays(message: Message) -> None:
    specs = {spec.name: spec for spec in tables().arrays(message.kind)}
    for name, array in message.arrays.items():
        if name not in specs:
            raise Malformed("12", f"{message.kind} has no array {name!r}")
        axes = specs[name].says["axes"]
        if array.ndim != len(axes) or f"<{array.dtype.kind}8" not in specs[name].says["dtypes"]:
            raise Malformed("5", f"{message.kind}.{name} must have the axes {axes}, got {array.dtype} {array.shape}")
    for name, spec in specs.items():
        if spec.required and name not in message.arrays:
            raise Malformed("12", f"{message.kind} must have the array {name}")
