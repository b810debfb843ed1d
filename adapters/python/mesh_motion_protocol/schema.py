"""Tables made from the declarations of :mod:`.messages`, and the checks that follow from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, fields
from types import NoneType, UnionType
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from mesh_motion_protocol.declarations import ArrayField, Choice, Length, Range
from mesh_motion_protocol.errors import ProtocolError
from mesh_motion_protocol.header import plain
from mesh_motion_protocol.messages import REPLIES, Message

__all__ = ["ArraySpec", "FieldSpec", "MessageSchema", "check_value", "schema_of", "sent_fields"]

#: Header fields of every message, next to ``fields``.
REQUEST_ID = ("client", "sequence")
_INTEGERS = range(-(2**63), 2**63)


@dataclass(frozen=True)
class FieldSpec:
    """A header field: its Python type, its markers, and whether a sender may leave it out.

    A field that is None is left out, even by a sender that knows the field: nil is not a value of the wire.
    """

    name: str
    kind: Any
    markers: tuple[Length | Choice | Range, ...]
    required: bool


@dataclass(frozen=True)
class ArraySpec:
    """An array field: its dtypes on the wire, the names of its axes, whether the receiver keeps integers of 4 bytes."""

    name: str
    dtypes: tuple[str, ...]
    axes: tuple[str, ...]
    required: bool
    narrow: bool = False


@dataclass(frozen=True)
class MessageSchema:
    """The fields of a message type, ``kind`` on the wire; ``request`` is true for requests, false for replies."""

    kind: str
    cls: type[Message]
    request: bool
    identity: tuple[FieldSpec, ...]
    fields: tuple[FieldSpec, ...]
    arrays: tuple[ArraySpec, ...]


def schema_of(cls: type[Message]) -> MessageSchema:
    """Return the table of a message class; it is made once."""
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
    """``Annotated[kind, markers...]`` → kind, markers; ``kind | None`` → kind."""
    markers: tuple[Any, ...] = ()
    if get_origin(hint) is Annotated:
        hint, *rest = get_args(hint)
        markers = tuple(rest)
    if get_origin(hint) is UnionType:
        (hint,) = (kind for kind in get_args(hint) if kind is not NoneType)
    return hint, markers


def _admitted(dtype: str) -> tuple[str, ...]:
    """Return the wire dtypes of a declaration: the wide ones, then the narrow ones that are widened on receipt."""
    wide = tuple(dtype.split("|"))
    return (*wide, *(d.replace("8", "4") for d in wide))


def sent_fields(message: Message, specs: Sequence[FieldSpec]) -> dict[str, Any]:
    """Return name → plain value of these fields, without those that are left out."""
    values = {spec.name: plain(getattr(message, spec.name)) for spec in specs}
    left_out = {spec.name for spec in specs if values[spec.name] is None and not spec.required}
    return {name: value for name, value in values.items() if name not in left_out}


def check_value(value: Any, spec: FieldSpec, *, finite: bool) -> None:
    """Check a header field against its declaration.

    Raises
    ------
    ProtocolError
        INVALID_ARGUMENT.HEADER for a wrong type, .VALUE outside choices, range or length, .NONFINITE for NaN or
        infinity if ``finite`` is true.
    """
    if spec.kind is float and type(value) is int:
        value = float(value)
    try:
        _check_kind(value, spec.kind, finite)
    except _WrongValueError as wrong:
        where = spec.name + "".join(reversed(wrong.steps))
        message, code = f"{where} {wrong}", f"INVALID_ARGUMENT.{wrong.subcode}"
        raise ProtocolError(message, code=code, details={"field": where}) from None
    for marker in spec.markers:
        _check_marker(value, marker, spec.name)


class _WrongValueError(Exception):
    """A wrong value, with the path from its field to it: items are named only when there is an error."""

    def __init__(self, text: str, subcode: str = "HEADER") -> None:
        super().__init__(text)
        self.subcode = subcode
        self.steps: list[str] = []


def _check_kind(value: Any, kind: Any, finite: bool) -> None:
    """Check the type of ``value``, recursively."""
    found = type(value)
    if kind is Any:
        wanted, inner = found, Any
        if found not in _PLAIN:
            raise _WrongValueError(f"has a value of type {found.__name__}, which the wire does not know")
    else:
        wanted, inner = get_origin(kind) or kind, (Any, *get_args(kind))[-1]
    if wanted is float and found is int:
        return
    if found is not wanted:
        raise _WrongValueError(f"must be {_PLAIN.get(wanted, wanted.__name__)}, got {found.__name__}")
    if found is float and finite and not math.isfinite(value):
        raise _WrongValueError(f"must be finite, got {value}", "NONFINITE")
    if found is int and value not in _INTEGERS:
        raise _WrongValueError(f"must fit in 64 bits with sign, got {value}")
    for step, item in value.items() if found is dict else enumerate(value) if found is list else ():
        if found is dict and type(step) is not str:
            raise _WrongValueError(f"must have text keys, got {type(step).__name__}")
        try:
            _check_kind(item, inner, finite)
        except _WrongValueError as wrong:
            wrong.steps.append(f".{step}" if found is dict else f"[{step}]")
            raise


#: Types of the wire, as errors name them.
_PLAIN = {str: "text", bytes: "binary", int: "an integer", float: "a number", bool: "true or false",
          list: "an array", dict: "a map", type(None): "null"}  # fmt: skip


def _check_marker(value: Any, marker: Length | Choice | Range, where: str) -> None:
    """Check the condition of a marker on the field's value."""
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
