"""Messages to frames and back.

Frame 0 is a msgpack map with exactly six keys: ``v``, ``type``, ``client``, ``sequence``, ``fields``, ``arrays``. The
frames after it are the arrays' bytes, in the order of ``arrays``. All checks here follow from the declarations in
:mod:`.messages`; the server itself checks whether a request makes sense for a session.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mesh_motion_protocol import PROTOCOL_VERSION
from mesh_motion_protocol.arrays import Buffer, array_of, declaration_of, frame_count, frames_of, nbytes_of
from mesh_motion_protocol.errors import ProtocolError
from mesh_motion_protocol.header import pack, unpack
from mesh_motion_protocol.limits import MESSAGE_BYTES
from mesh_motion_protocol.messages import MESSAGES, Message
from mesh_motion_protocol.schema import ArraySpec, FieldSpec, MessageSchema, check_value, schema_of, sent_fields
from mesh_motion_protocol.shared_memory import SharedMemory, written

__all__ = ["decode", "encode"]

_KEYS = frozenset({"v", "type", "client", "sequence", "fields", "arrays"})
_ARRAY_KEYS = frozenset({"name", "dtype", "shape"})
_DECLARATIONS = FieldSpec("arrays", list[dict[str, Any]], (), required=True)


def encode(message: Message, memory: Mapping[str, Any] | None = None) -> list[Buffer]:
    """Put a message into frames.

    Array frames are views of the message's arrays: leave these unchanged until the frames are sent.

    Parameters
    ----------
    memory : mapping, optional
        Memory that the receiver offers: large arrays are written there, if possible, and have no frames.

    Raises
    ------
    ProtocolError
        If a field or array differs from the message's declaration, or a limit is exceeded.
    """
    schema = schema_of(type(message))
    values = sent_fields(message, (*schema.identity, *schema.fields))
    _check_fields(values, (*schema.identity, *schema.fields), finite=schema.request)
    declared, frames = _encode_arrays(message, schema, memory)
    header = {
        "v": PROTOCOL_VERSION[0],
        "type": schema.kind,
        "client": values.pop("client"),
        "sequence": values.pop("sequence"),
        "fields": values,
        "arrays": declared,
    }
    return [pack(header), *frames]


def _encode_arrays(
    message: Message, schema: MessageSchema, memory: Mapping[str, Any] | None
) -> tuple[list[dict[str, Any]], list[Buffer]]:
    """Declarations and frames of all arrays, in the order of the class."""
    given = [(spec, getattr(message, spec.name)) for spec in schema.arrays]
    pairs = [(spec, np.asarray(value)) for spec, value in given if value is not None or spec.required]
    declared = [declaration_of(array, spec) for spec, array in pairs]
    places = written(memory, [array for _, array in pairs]) if memory else {}
    frames: list[Buffer] = []
    for index, (_, array) in enumerate(pairs):
        if index in places:
            declared[index]["at"] = places[index]
        else:
            frames += frames_of(array)
    return declared, frames


def decode(
    frames: Sequence[Buffer], *, message_bytes: int = MESSAGE_BYTES, memory: SharedMemory | None = None
) -> Message:
    """Read a message from frames; every array is aligned and writable, and belongs to the caller.

    Parameters
    ----------
    frames : sequence of bytes-like
        Frame 0 and the arrays' frames. Do not use writable frames afterwards: a large one becomes the memory of its
        array.
    message_bytes : int
        Limit on all arrays together.
    memory : SharedMemory, optional
        Memory that was offered for the message's arrays: arrays in it stay there.

    Raises
    ------
    ProtocolError
        If the frames are not a message of this version; ``client`` and ``sequence`` are set if they were readable.
    """
    if not frames:
        raise _malformed("a message must have at least one frame, got none")
    header = unpack(memoryview(frames[0]))
    try:
        return _decode(header, frames[1:], message_bytes, memory)
    except ProtocolError as error:
        error.client, error.sequence = _request_id(header)
        raise


def _decode(
    header: dict[str, Any], frames: Sequence[Buffer], message_bytes: int, memory: SharedMemory | None
) -> Message:
    schema = _schema(header)
    values = header["fields"]
    if not isinstance(values, dict):
        raise _malformed(f"fields must be a map, got {type(values).__name__}")
    identity = {spec.name: header[spec.name] for spec in schema.identity}
    _check_fields(identity, schema.identity, finite=True)
    if schema.request and not identity["sequence"]:
        raise ProtocolError("sequence must be 1 or more in a request, got 0", code="INVALID_ARGUMENT.VALUE")
    known = {spec.name for spec in schema.fields}
    if schema.request and (unknown := sorted(values.keys() - known)):
        raise _malformed(f"{schema.kind} has no field {unknown[0]!r}", unknown[0])
    values = {name: value for name, value in values.items() if name in known}
    _check_fields(values, schema.fields, finite=schema.request)
    arrays = _decode_arrays(header["arrays"], frames, schema, message_bytes, memory)
    return schema.cls(**identity, **values, **arrays)


def _schema(header: dict[str, Any]) -> MessageSchema:
    """Check version, keys and type of a header; the version first, because another version may have other keys."""
    if header.get("v") != PROTOCOL_VERSION[0] or type(header["v"]) is not int:
        raise ProtocolError(
            f"this is protocol version {PROTOCOL_VERSION[0]}, got {header.get('v')!r:.40}",
            code="UNIMPLEMENTED.VERSION",
            details={"versions": [list(PROTOCOL_VERSION)]},
        )
    if header.keys() != _KEYS:
        offender = sorted(header.keys() ^ _KEYS)[0]
        raise _malformed(f"frame 0 must have exactly the keys {', '.join(sorted(_KEYS))}; see {offender!r}", offender)
    kind = header["type"]
    if type(kind) is not str:
        raise _malformed(f"type must be text, got {type(kind).__name__}", "type")
    if kind not in MESSAGES:
        raise ProtocolError(f"there is no message type {kind!r:.40}", code="UNIMPLEMENTED.MESSAGE")
    return schema_of(MESSAGES[kind])


def _check_fields(values: dict[str, Any], specs: Sequence[FieldSpec], *, finite: bool) -> None:
    for spec in specs:
        if spec.name in values:
            check_value(values[spec.name], spec, finite=finite)
        elif spec.required:
            raise _malformed(f"the field {spec.name!r} is missing", spec.name)


def _decode_arrays(
    declared: Any, frames: Sequence[Buffer], schema: MessageSchema, message_bytes: int, memory: SharedMemory | None
) -> dict[str, Any]:
    """Match declarations with the arrays of the class, and frames with declarations."""
    check_value(declared, _DECLARATIONS, finite=True)
    specs = {spec.name: spec for spec in schema.arrays}
    pairs = [_array_spec(item, specs, schema, shared=memory is not None) for item in declared]
    names = [spec.name for _, spec in pairs]
    if len(set(names)) < len(names):
        raise _malformed("an array is declared twice", "arrays")
    for name, spec in specs.items():
        if spec.required and name not in names:
            raise _malformed(f"the array {name!r} is missing", name)
    sizes = [nbytes_of(item, spec) for item, spec in pairs]
    if sum(sizes) > message_bytes:
        raise ProtocolError(
            f"the arrays of a message may have {message_bytes} bytes, got {sum(sizes)}", code="RESOURCE_EXHAUSTED.BYTES"
        )
    counts = [0 if "at" in item else frame_count(size) for size, (item, _) in zip(sizes, pairs, strict=True)]
    if sum(counts) != len(frames):
        raise ProtocolError(
            f"the declared arrays need {sum(counts)} frames, got {len(frames)}", code="INVALID_ARGUMENT.FRAMES"
        )
    arrays, start = {}, 0
    for (item, spec), count in zip(pairs, counts, strict=True):
        arrays[spec.name] = array_of(item, frames[start : start + count], spec, memory)
        start += count
    return arrays


def _array_spec(
    declared: dict[str, Any], specs: dict[str, ArraySpec], schema: MessageSchema, *, shared: bool
) -> tuple[dict[str, Any], ArraySpec]:
    """Check one entry of ``arrays``; return it with its declaration."""
    if (declared.keys() - {"at"} if shared else declared.keys()) != _ARRAY_KEYS:
        raise _malformed("each entry of arrays must have exactly the keys name, dtype, shape", "arrays")
    name = declared["name"]
    if type(name) is not str or name not in specs:
        raise _malformed(f"{schema.kind} has no array {name!r:.40}", "arrays")
    if type(declared["dtype"]) is not str or type(declared["shape"]) is not list:
        raise _malformed(f"{name}: dtype must be text and shape an array of integers", name)
    return declared, specs[name]


def _request_id(header: dict[str, Any]) -> tuple[bytes, int]:
    """Return the request id of a header with another error; zeros if the id itself is wrong."""
    client, sequence = header.get("client"), header.get("sequence")
    good_client = type(client) is bytes and len(client) == 16
    good_sequence = type(sequence) is int and sequence in range(2**63)
    return (client if good_client else b"\0" * 16), (sequence if good_sequence else 0)  # type: ignore[return-value]


def _malformed(message: str, where: str = "") -> ProtocolError:
    return ProtocolError(message, code="INVALID_ARGUMENT.HEADER", details={"field": where} if where else None)
