"""Writes the golden vectors: ``python -m mesh_motion_protocol.vectors.generate``.

The valid vectors come from :mod:`.samples` and from headers packed by hand, in other forms that a sender may use; each
invalid vector is a valid message with one error.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgpack
import numpy as np

from mesh_motion_protocol.codec import decode, encode
from mesh_motion_protocol.limits import CONTAINER_ITEMS, HEADER_DEPTH
from mesh_motion_protocol.messages import Message
from mesh_motion_protocol.schema import schema_of, sent_fields
from mesh_motion_protocol.vectors.samples import MESSAGES

__all__ = ["invalid_cases", "plain_message", "render", "valid_cases"]

_BY_TYPE = {message.type: message for message in MESSAGES}
Frames = list[bytes]
Header = dict[str, Any]


def plain_message(message: Message) -> dict[str, Any]:
    """Return a message as JSON values: binary as ``{"hex": …}``, arrays as ``{"dtype", "shape", "values"}``."""
    schema = schema_of(type(message))
    arrays = {spec.name: _plain_array(getattr(message, spec.name)) for spec in schema.arrays}
    return {
        "type": schema.kind,
        "client": _plain(message.client),
        "sequence": message.sequence,
        "fields": {name: _plain(value) for name, value in sent_fields(message, schema.fields).items()},
        "arrays": {name: array for name, array in arrays.items() if array is not None},
    }


def valid_cases() -> list[dict[str, Any]]:
    """Return frames that are messages. ``canonical``: encoding the message gives the same frames."""
    cases = [_valid(message.type.lower(), "12", _frames(message), canonical=True) for message in MESSAGES]
    for name, section, frames in _variants():
        cases.append(_valid(name, section, frames, canonical=False))
    return cases


def invalid_cases() -> list[dict[str, Any]]:
    """Return frames that are no messages, with the error code and the reason."""
    groups = {"4": (*_broken_headers(), *_broken_keys()), "12": _broken_fields(), "5": _broken_arrays()}
    return [
        {"name": name, "section": section, "frames": [frame.hex() for frame in frames], "error": code, "why": why}
        for section, cases in groups.items()
        for name, frames, code, why in cases
    ]


def render(cases: list[dict[str, Any]]) -> str:
    """Return the file's text: one case a line, so that each change shows as one line."""
    return "[\n" + ",\n".join(json.dumps(case, ensure_ascii=False) for case in cases) + "\n]\n"


def _valid(name: str, section: str, frames: Frames, *, canonical: bool) -> dict[str, Any]:
    message = plain_message(decode(frames))
    return {
        "name": name,
        "section": section,
        "canonical": canonical,
        "frames": [f.hex() for f in frames],
        "message": message,
    }


def _frames(message: Message) -> Frames:
    return [bytes(frame) for frame in encode(message)]


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return {"hex": value.hex()}
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list) else value


def _plain_array(array: Any) -> dict[str, Any] | None:
    if array is None:
        return None
    wide = f"<{array.dtype.kind}8"  # independent of the item width
    return {"dtype": wide, "shape": list(array.shape), "values": array.ravel().tolist()}


def _header(kind: str, change: Callable[[Header], Any] | None = None) -> Header:
    """Return the header of the sample of this type, with one change."""
    header: Header = msgpack.unpackb(encode(_BY_TYPE[kind])[0], strict_map_key=False)
    if change is not None:
        change(header)
    return header


def _changed(kind: str, change: Callable[[Header], Any]) -> Frames:
    return [msgpack.packb(_header(kind, change)), *_frames(_BY_TYPE[kind])[1:]]


def _without(key: str) -> Callable[[Header], Any]:
    return lambda header: header.pop(key)


def _field(kind: str, name: str, value: Any) -> Frames:
    return _changed(kind, lambda header: header["fields"].update({name: value}))


def _array(kind: str, key: str, value: Any) -> Frames:
    return _changed(kind, lambda header: header["arrays"][0].update({key: value}))


def _variants() -> Iterable[tuple[str, str, Frames]]:
    """Return other encodings that a receiver must accept."""
    narrow = np.array([[0.5, -0.25], [0.125, 3.0]], dtype="<f4").tobytes()
    yield "move-f4-is-widened", "5.1", [_array("MOVE", "dtype", "<f4")[0], narrow]
    moving = np.array([2, 3], "<i4").tobytes()
    yield "joined-i4-is-widened", "5.1", [_array("JOINED", "dtype", "<i4")[0], moving, *_frames(_BY_TYPE["JOINED"])[2:]]
    yield "defaults-left-out", "4", _changed("OPEN", lambda header: header.update(fields={"dimension": 3}))
    yield "optional-array-left-out", "12", [_changed("JOINED", lambda header: header.update(arrays=[]))[0]]
    faces = np.array([[0, 1], [2, -1]])
    asked = {"report": "swept", "velocity": "tangent", "swept_faces": faces, "boundary_velocity": faces / 2}
    yield "move-with-three-arrays", "25", _frames(replace(_BY_TYPE["MOVE"], **asked))  # type: ignore[arg-type]
    yield "time-left-out", "25.1", _changed("MOVE", lambda header: header["fields"].pop("time"))
    yield "empty-array-has-no-frame", "5.3", [_array("MOVE", "shape", [0, 2])[0]]
    yield "keys-in-another-order", "4", [msgpack.packb(dict(reversed(_header("PING").items())))]
    yield "unknown-field-in-a-reply-is-ignored", "4", _field("COMMITTED", "from_a_later_version", 1)
    ping, wide = _frames(_BY_TYPE["PING"])[0], b"\xa8sequence\xd3" + (7).to_bytes(8, "big")
    yield "integer-in-64-bits", "4.4", [ping.replace(b"\xa8sequence\x07", wide)]
    yield "largest-sequence", "4", _changed("PING", lambda header: header.update(sequence=2**63 - 1))
    yield "integer-where-a-number-is-asked", "4.5", _field("MOVED", "seconds", {"total": 1})
    for bits, code in ((8, b"\xd0"), (16, b"\xd1"), (32, b"\xd2")):
        raw = b"\xa8sequence" + code + (7).to_bytes(bits // 8, "big")
        yield f"integer-in-{bits}-bits", "4.4", [ping.replace(b"\xa8sequence\x07", raw)]
    for bits, code in ((8, b"\xcc"), (16, b"\xcd"), (32, b"\xce"), (64, b"\xcf")):
        raw = b"\xa8sequence" + code + (7).to_bytes(bits // 8, "big")
        yield f"unsigned-integer-in-{bits}-bits", "4.4", [ping.replace(b"\xa8sequence\x07", raw)]
    yield "map-in-32-bits", "4", [b"\xdf" + (6).to_bytes(4, "big") + ping[1:]]
    yield "map-in-16-bits", "4", [b"\xde" + (6).to_bytes(2, "big") + ping[1:]]
    yield "text-in-8-bits", "4", [ping.replace(b"\xa4PING", b"\xd9\x04PING")]
    yield "text-in-16-bits", "4", [ping.replace(b"\xa4PING", b"\xda\x00\x04PING")]
    yield "binary-in-16-bits", "4", [ping.replace(b"\xc4\x10", b"\xc5\x00\x10")]
    yield "binary-in-32-bits", "4", [ping.replace(b"\xc4\x10", b"\xc6\x00\x00\x00\x10")]
    yield (
        "empty-containers-in-16-bits",
        "4",
        [ping.replace(b"fields\x80", b"fields\xde\0\0").replace(b"arrays\x90", b"arrays\xdc\0\0")],
    )
    yield "nil-inside-a-map", "4.7", _field("OPEN", "settings", {"support_radius": None})
    yield (
        "float-of-32-bits",
        "4.5",
        [_frames(_BY_TYPE["OPEN"])[0].replace(b"\xcb\x3f\xe0" + bytes(6), b"\xca\x3f\0\0\0")],
    )
    yield "twelve-levels", "4.9", _field("OPEN", "settings", {"a": _nested(HEADER_DEPTH - 3)})
    yield "256-items", "4.9", _field("OPEN", "settings", {str(number): 0 for number in range(CONTAINER_ITEMS)})
    yield "utf-8-of-four-bytes", "4.2", _field("OPEN", "label", "a\u00e9\u20ac\U0001f600")
    yield "label-of-256-bytes", "12", _field("OPEN", "label", "\u00e9" * 128)
    yield "unknown-error-detail", "17", _field("ERROR", "code", "ABORTED.FROM_A_LATER_VERSION")
    yield "upload-of-i4", "5.1", [_array("UPLOAD", "dtype", "<i4")[0], np.arange(8, dtype="<i4").tobytes()]
    yield "upload-of-f4", "5.1", [_array("UPLOAD", "dtype", "<f4")[0], np.arange(8, dtype="<f4").tobytes()]
    yield "upload-without-rows", "12", [_changed("UPLOAD", lambda header: header.update(arrays=[]))[0]]
    shape = _array("FETCHED", "shape", [2, 3])[0]
    yield "three-coordinates", "5.4", [shape, np.arange(6, dtype="<f8").tobytes()]
    yield "one-coordinate", "5.4", [_array("FETCHED", "shape", [6, 1])[0], np.arange(6, dtype="<f8").tobytes()]


def _nested(levels: int) -> Any:
    """Return 1 inside this many nested arrays."""
    return [_nested(levels - 1)] if levels else 1


def _broken_headers() -> Iterable[tuple[str, Frames, str, str]]:
    """Return cases with an error in frame 0 itself."""
    ping = _frames(_BY_TYPE["PING"])[0]
    code = "INVALID_ARGUMENT.HEADER"
    yield "empty-header", [b""], code, "frame 0 has no byte"
    yield "not-a-map", [msgpack.packb([1, 2])], code, "frame 0 is an array"
    yield "cut-off", [ping[:-1]], code, "the map ends too early"
    yield "trailing-byte", [ping + b"\xc0"], code, "a byte behind the map"
    yield "reserved-byte", [b"\xc1"], code, "0xc1 is never used in msgpack"
    yield "key-twice", [b"\x87" + ping[1:] + b"\xa1v\x01"], code, "the key v comes twice"
    yield "binary-key", [ping.replace(b"\xa1v", b"\xc4\x01v")], code, "keys are text"
    yield "integer-key", [ping.replace(b"\xa1v", b"\x01")], code, "keys are text"
    yield "bad-utf-8", [ping.replace(b"\xa4PING", b"\xa4PI\xff\xfe")], code, "text is UTF-8"
    yield "extension", [ping.replace(b"\xa4PING", b"\xd4\x05\x00")], code, "no extension types"
    yield "timestamp", [ping.replace(b"\xa4PING", b"\xd6\xff\0\0\0\0")], code, "no extension types"
    yield "deep", [b"\x91" * 2000], code, "nested deeper than the limit"
    yield (
        "one-level-too-deep",
        _field("OPEN", "settings", {"a": _nested(HEADER_DEPTH - 2)}),
        code,
        "nested deeper than the limit",
    )
    yield "declared-huge-array", [b"\xdd\xff\xff\xff\xff"], code, "four billion items announced"
    yield "declared-huge-map", [b"\xdf\xff\xff\xff\xff"], code, "four billion items announced"
    yield "declared-huge-text", [b"\xdb\xff\xff\xff\xff"], code, "four billion bytes announced"
    many = {str(number): 0 for number in range(CONTAINER_ITEMS + 1)}
    yield "too-many-items", _field("OPEN", "settings", many), code, "a map with more items than the limit"


def _broken_keys() -> Iterable[tuple[str, Frames, str, str]]:
    """Return cases with an error in the six keys of the header."""
    code = "INVALID_ARGUMENT.HEADER"
    for key in ("type", "client", "sequence", "fields", "arrays"):
        yield f"without-{key}", _changed("PING", _without(key)), code, f"the key {key} is missing"
    yield "extra-key", _changed("PING", lambda h: h.update(x=1)), code, "exactly six keys"
    version = "UNIMPLEMENTED.VERSION"
    yield "without-v", _changed("PING", lambda h: h.pop("v")), version, "v is the version"
    yield "version-2", _changed("PING", lambda h: h.update(v=2)), version, "another major version"
    yield "version-true", _changed("PING", lambda h: h.update(v=True)), version, "true is not 1"
    yield "unknown-type", _changed("PING", lambda h: h.update(type="PUNG")), "UNIMPLEMENTED.MESSAGE", "no such type"
    yield "type-number", _changed("PING", lambda h: h.update(type=1)), code, "type is text"
    yield "client-text", _changed("PING", lambda h: h.update(client="0" * 16)), code, "client is binary"
    value = "INVALID_ARGUMENT.VALUE"
    yield "client-short", _changed("PING", lambda h: h.update(client=b"0" * 15)), value, "client has 16 bytes"
    yield "sequence-0", _changed("PING", lambda h: h.update(sequence=0)), value, "requests count from 1"
    yield "sequence-negative", _changed("PING", lambda h: h.update(sequence=-1)), value, "requests count from 1"
    yield "sequence-64-bits", _changed("PING", lambda h: h.update(sequence=2**63)), code, "integers have 63 bits"
    yield "sequence-float", _changed("PING", lambda h: h.update(sequence=1.0)), code, "sequence is an integer"
    yield "fields-array", _changed("PING", lambda h: h.update(fields=[])), code, "fields is a map"
    yield "arrays-map", _changed("PING", lambda h: h.update(arrays={})), code, "arrays is an array"


def _broken_fields() -> Iterable[tuple[str, Frames, str, str]]:
    """Return cases with an error in the fields of requests."""
    header, value = "INVALID_ARGUMENT.HEADER", "INVALID_ARGUMENT.VALUE"
    yield "field-missing", _changed("MOVE", lambda h: h["fields"].pop("step")), header, "step has no default"
    yield (
        "move-without-frame",
        _changed("MOVE", lambda h: h["fields"].pop("frame")),
        header,
        "totals and increments are distinguished",
    )
    yield "field-unknown", _field("MOVE", "stepp", 1), header, "requests have no unknown fields"
    yield "field-text", _field("MOVE", "step", "13"), header, "step is an integer"
    yield "field-bool", _field("MOVE", "step", True), header, "true is not 1"
    yield "field-nil", _field("MOVE", "step", None), header, "nil is no integer"
    yield "time-nil", _field("MOVE", "time", None), header, "nil is no number: a time that is not known is left out"
    nowhere = _field("COMMIT", "time", float("inf"))
    yield "time-infinite", nowhere, "INVALID_ARGUMENT.NONFINITE", "numbers in requests are finite"
    yield "way-unknown", _field("MOVE", "headroom_along", "tangent"), value, "no such way"
    yield "scheme-unknown", _field("MOVE", "velocity", "bdf3"), value, "no such scheme"
    yield "step-negative", _field("MOVE", "step", -1), value, "steps are not negative"
    yield "dimension-4", _field("OPEN", "dimension", 4), value, "1, 2 or 3 dimensions"
    yield "dimension-0", _field("OPEN", "dimension", 0), value, "1, 2 or 3 dimensions"
    yield "partitions-0", _field("OPEN", "partitions", 0), value, "at least one partition"
    yield "partition-256", _field("JOIN", "partition", 256), value, "at most 256 partitions"
    yield "frame-unknown", _field("MOVE", "frame", "absolute"), value, "committed or reference"
    yield "role-unknown", _field("UPLOAD", "role", "sliding"), value, "no such role"
    yield "item-unknown", _field("UPLOAD", "item", "faces"), value, "no such item"
    yield "token-short", _field("JOIN", "token", b"short"), value, "a token has 32 bytes"
    yield "label-long", _field("OPEN", "label", "x" * 257), value, "a label has at most 256 bytes"
    yield "settings-array", _field("OPEN", "settings", []), header, "settings is a map"
    nan = _field("OPEN", "settings", {"support_radius": float("nan")})
    yield "settings-nan", nan, "INVALID_ARGUMENT.NONFINITE", "numbers in requests are finite"


def _broken_arrays() -> Iterable[tuple[str, Frames, str, str]]:
    """Return cases with an error in the declarations of arrays or in their frames."""
    dtype, shape, count = (f"INVALID_ARGUMENT.{detail}" for detail in ("DTYPE", "SHAPE", "FRAMES"))
    header = "INVALID_ARGUMENT.HEADER"
    for text in ("O", ">f8", "<f2", "float64", "S2147483647", "<i8"):
        yield f"dtype-{text}", _array("MOVE", "dtype", text), dtype, "displacement is <f8 or <f4"
    yield "dtype-number", _array("MOVE", "dtype", 8), header, "a dtype is text"
    yield "shape-text", _array("MOVE", "shape", "2,2"), header, "a shape is an array"
    yield "shape-rank-1", _array("MOVE", "shape", [4]), shape, "displacement has two axes"
    yield "shape-rank-3", _array("MOVE", "shape", [2, 2, 1]), shape, "displacement has two axes"
    yield "shape-negative", _array("MOVE", "shape", [-2, -2]), shape, "lengths are not negative"
    yield "shape-float", _array("MOVE", "shape", [2.0, 2]), shape, "lengths are integers"
    yield "shape-4-columns", _array("MOVE", "shape", [1, 4]), shape, "at most three coordinates"
    yield "shape-overflow", _array("MOVE", "shape", [2**62, 2]), shape, "more rows than any machine holds"
    yield "shape-large", _array("MOVE", "shape", [2**40, 2]), "RESOURCE_EXHAUSTED.BYTES", "more than message_bytes"
    yield "frame-missing", _frames(_BY_TYPE["MOVE"])[:1], count, "one frame is declared"
    yield "frame-extra", [*_frames(_BY_TYPE["MOVE"]), b"x"], count, "one frame is declared"
    yield "frame-behind-ping", [*_frames(_BY_TYPE["PING"]), b""], count, "no frame is declared"
    yield "frame-short", [_frames(_BY_TYPE["MOVE"])[0], b"\0" * 31], count, "the shape needs 32 bytes"
    yield "frame-long", [_frames(_BY_TYPE["MOVE"])[0], b"\0" * 33], count, "the shape needs 32 bytes"
    yield "array-missing", [_changed("MOVE", lambda h: h.update(arrays=[]))[0]], header, "displacement is required"
    yield "array-unknown", _array("MOVE", "name", "force"), header, "MOVE has no array force"
    yield "array-extra-key", _array("MOVE", "order", "F"), header, "exactly name, dtype, shape"
    twice = _changed("MOVE", lambda h: h.update(arrays=h["arrays"] * 2))
    yield "array-twice", [*twice, twice[1]], header, "an array is declared twice"


def main() -> None:
    """Write both files next to this module."""
    here = Path(__file__).parent
    for name, cases in (("valid", valid_cases()), ("invalid", invalid_cases())):
        here.joinpath(f"{name}.json").write_text(render(cases), encoding="utf-8")


if __name__ == "__main__":
    main()
