"""The declarations of :mod:`.messages` read into tables, and the checks that follow from them."""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass, fields
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from mesh_motion_protocol.declarations import ArrayField, Choice, Length, Range
from mesh_motion_protocol.errors import ProtocolError
from mesh_motion_protocol.messages import REPLIES, Message

__all__ = ["ArraySpec", "FieldSpec", "MessageSchema", "check_value", "schema_of"]

#: In the header beside ``fields``, for every message.
REQUEST_ID = ("client", "sequence")
_INTEGERS = range(-(2**63), 2**63)


@dataclass(frozen=True)
class FieldSpec:
    """A header field: its Python type, its markers, and whether a sender may leave it out."""

    name: str
    kind: Any
    markers: tuple[Length | Choice | Range, ...]
    required: bool


@dataclass(frozen=True)
class ArraySpec:
    """An array field: admitted dtypes on the wire, the axes' names, whether integers of 4 bytes stay so on receipt."""

    name: str
    dtypes: tuple[str, ...]
    axes: tuple[str, ...]
    required: bool
    narrow: bool = False


@dataclass(frozen=True)
class MessageSchema:
    """What a message type, ``kind`` on the wire, consists of; ``request`` tells requests from replies."""

    kind: str
    cls: type[Message]
    request: bool
    identity: tuple[FieldSpec, ...]
    fields: tuple[FieldSpec, ...]
    arrays: tuple[ArraySpec, ...]


def schema_of(cls: type[Message]) -> MessageSchema:
    """The table of a message class, read once."""
    if cls not in _SCHEMAS:
        _SCHEMAS[cls] = _read(cls)
    return _SCHEMAS[cls]


_SCHEMAS: dict[type[Message], MessageSchema] = {}


def _read(cls: type[Message]) -> MessageSchema:
    """Read the declarations of a message class."""
    hints = get_type_hints(cls, include_extras=True)
    specs: list[FieldSpec] = []
    arrays: list[ArraySpec] = []
    for item in fields(cls):
        kind, markers = _split(hints[item.name])
        array = next((m for m in markers if isinstance(m, ArrayField)), None)
        if array is not None:
            arrays.append(ArraySpec(item.name, _admitted(array.dtype), array.axes, array.required, array.narrow))
        else:
            required = item.default is MISSING and item.default_factory is MISSING
            specs.append(FieldSpec(item.name, kind, markers, required))
    identity = tuple(spec for spec in specs if spec.name in REQUEST_ID)
    plain = tuple(spec for spec in specs if spec.name not in REQUEST_ID)
    return MessageSchema(cls.type, cls, cls.type in REPLIES, identity, plain, tuple(arrays))


def _split(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    """``Annotated[kind, markers...]`` → kind, markers."""
    if get_origin(hint) is Annotated:
        kind, *markers = get_args(hint)
        return kind, tuple(markers)
    return hint, ()


def _admitted(dtype: str) -> tuple[str, ...]:
    """Wire dtypes of a declaration: the wide ones first, the narrow ones that are widened on receipt last."""
    wide = tuple(dtype.split("|"))
    return (*wide, *(d.replace("8", "4") for d in wide))


def check_value(value: Any, spec: FieldSpec, *, finite: bool) -> None:
    """Check a header field against its declaration.

    Raises
    ------
    ProtocolError
        INVALID_ARGUMENT.HEADER for a wrong type, .VALUE outside choices, range or length, .NONFINITE for NaN or
        infinity where ``finite`` is asked for.
    """
    if spec.kind is float and type(value) is int:
        value = float(value)
    _check_kind(value, spec.kind, spec.name, finite)
    for marker in spec.markers:
        _check_marker(value, marker, spec.name)


def _check_kind(value: Any, kind: Any, where: str, finite: bool) -> None:
    """The type of ``value``, recursively."""
    if kind is Any and _is_plain(value, finite):
        return  # without a name for each of its items
    origin = get_origin(kind) or kind
    if origin is Any:
        origin = _plain_type(value, where)
    if origin is float and type(value) is int:
        return
    if type(value) is not origin:
        wanted = getattr(origin, "__name__", str(origin))
        raise _malformed(f"{where} must be {_NAMES.get(wanted, wanted)}, got {type(value).__name__}", where)
    if origin is float and finite and not math.isfinite(value):
        raise ProtocolError(
            f"{where} must be finite, got {value}", code="INVALID_ARGUMENT.NONFINITE", details={"field": where}
        )
    if origin is int and value not in _INTEGERS:
        raise _malformed(f"{where} must fit in 64 bits with sign, got {value}", where)
    inner = get_args(kind)
    if origin is list:
        for index, item in enumerate(value):
            _check_kind(item, inner[0] if inner else Any, f"{where}[{index}]", finite)
    elif origin is dict:
        for key, item in value.items():
            if type(key) is not str:
                raise _malformed(f"{where} must have text keys, got {type(key).__name__}", where)
            _check_kind(item, inner[1] if inner else Any, f"{where}.{key}", finite)


_NAMES = {"str": "text", "bytes": "binary", "int": "an integer", "float": "a number", "bool": "true or false",
          "list": "an array", "dict": "a map"}  # fmt: skip
_PLAIN = (type(None), bool, int, float, str, bytes, list, dict)


def _is_plain(value: Any, finite: bool) -> bool:
    """Whether nothing is wrong with a value of any type."""
    kind = type(value)
    if kind is float:
        return not finite or math.isfinite(value)
    if kind is int:
        return value in _INTEGERS
    if kind is list:
        return all(_is_plain(item, finite) for item in value)
    if kind is dict:
        return all(type(key) is str and _is_plain(item, finite) for key, item in value.items())
    return kind in _PLAIN


def _plain_type(value: Any, where: str) -> type:
    if type(value) not in _PLAIN:
        raise _malformed(f"{where} has a value of type {type(value).__name__}, which the wire does not know", where)
    return type(value)


def _check_marker(value: Any, marker: Length | Choice | Range, where: str) -> None:
    """A field's own condition on its value."""
    if isinstance(marker, Choice):
        good, wanted = value in marker.values, "one of " + ", ".join(repr(v) for v in marker.values)
    elif isinstance(marker, Range):
        good, wanted = marker.low <= value <= marker.high, f"between {marker.low} and {marker.high}"
    else:
        size = len(value.encode() if isinstance(value, str) else value)
        good = size == marker.exactly if marker.exactly is not None else size <= (marker.at_most or 0)
        wanted = f"{marker.exactly} bytes" if marker.exactly is not None else f"at most {marker.at_most} bytes"
    if not good:
        shown = f"{len(value)} bytes" if isinstance(value, bytes) else repr(value)[:80]
        raise ProtocolError(
            f"{where} must be {wanted}, got {shown}", code="INVALID_ARGUMENT.VALUE", details={"field": where}
        )


def _malformed(message: str, where: str) -> ProtocolError:
    return ProtocolError(message, code="INVALID_ARGUMENT.HEADER", details={"field": where})
