"""Section 4: frame 0 is one msgpack map, and SPEC.md fixes everything that msgpack leaves open."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from typing import Any

from mesh_motion_conformance.case import require
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.server.requests import Header, Request
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.show import show
from mesh_motion_conformance.wire import KEYS, pack

_HEADER, _VALUE = "INVALID_ARGUMENT.HEADER", "INVALID_ARGUMENT.VALUE"
Change = Callable[[Header], Any]
#: Name, demand, and the arguments of :func:`_wrong`.
Rows = Iterator[tuple[Any, ...]]
_PING = Request("PING")


def _wrong(stage: Stage, request: Request, change: Change | None = None, *codes: str) -> None:
    """A request to the control endpoint is refused with one of the codes, or as a wrong header."""
    line = stage.control
    stage.put(line, request.frames(line.client, line.next(), change))
    refused(line.receive(), *(codes or (_HEADER,)), state="")


def _setting(value: Any) -> Request:
    """A request with this value inside a field of type map."""
    return Request("OPEN", {"dimension": 2, "settings": {"a": value}})


def _raw(before: bytes, after: bytes) -> Change:
    """Frame 0 with some of its bytes replaced."""
    return lambda header: pack(header).replace(before, after, 1)


# --- the six keys ----------------------------------------------------------------------------------------------------


@suite.family(_wrong, "4")
def keys() -> Rows:
    """Exactly the six keys, each of its type."""
    for key in KEYS:
        code = "UNIMPLEMENTED.VERSION" if key == "v" else _HEADER
        yield f"without-{key}", f"frame 0 has the key {key}", _PING, _drop(key), code
    yield "seventh-key", "exactly these keys", _PING, lambda h: h | {"x": 1}
    wrong: dict[str, list[Any]] = {
        "type": [1, b"PING", None, ["PING"], True],
        "client": ["0" * 16, 1, None, [1] * 16],
        "sequence": ["1", 1.0, None, True, [1], b"1"],
        "fields": [[], None, 1, "x", b""],
        "arrays": [{}, None, 1, "x", b""],
    }
    for key, values in wrong.items():
        for value in values:
            name = f"{key}-is-{type(value).__name__.lower()}"
            yield name, f"the type of {key}", _PING, _set(key, value)
    for value in (0, 2, -1, 255, 1.0, True, None, "1", [1]):
        name = f"v-is-{value}".replace("[1]", "an-array").replace("-1", "minus-1")
        demand = "v is the int 1; a header of another version is answered with ours"
        yield name, demand, _PING, _set("v", value), "UNIMPLEMENTED.VERSION"
    for size in (0, 15, 17, 32):
        yield f"client-of-{size}-bytes", "client has 16 bytes", _PING, _set("client", bytes(size)), _VALUE
    for value in (0, -1, -(2**63)):
        yield f"sequence-{value}", "sequence is 1 … 2⁶³−1", _PING, _set("sequence", value), _VALUE
    for kind in ("PUNG", "", "ping", "MOVE ", "SHUTDOWN"):
        yield f"type-{kind!r}", "a type of section 12", Request(kind), None, "UNIMPLEMENTED.MESSAGE"


def _drop(key: str) -> Change:
    return lambda header: {name: value for name, value in header.items() if name != key}


def _set(key: str, value: Any) -> Change:
    return lambda header: header | {key: value}


@suite("4", {f"keys-beginning-with-{key}": (turn,) for turn, key in enumerate(KEYS)})
def order_of_keys(stage: Stage, turn: int) -> None:
    """The keys may come in any order."""
    names = [*KEYS[turn:], *KEYS[:turn]]
    answered(stage.ask(_PING, change=lambda header: {name: header[name] for name in names}), "PONG")


_READABLE: dict[str, tuple[Change, bool, bool]] = {
    "id-with-a-wrong-type": (_set("type", 1), True, True),
    "id-with-a-wrong-version": (_set("v", 2), True, True),
    "id-with-wrong-fields": (_set("fields", []), True, True),
    "id-with-an-unknown-field": (_set("fields", {"x": 1}), True, True),
    "id-with-a-wrong-client": (_set("client", "x"), False, True),
    "id-with-a-wrong-sequence": (_set("sequence", "x"), True, False),
    "id-of-an-unreadable-header": (lambda header: pack(header)[:-3], False, False),
}


@suite("4", _READABLE)
def identity_in_errors(stage: Stage, change: Change, client: bool, sequence: bool) -> None:
    """An ERROR has the request id as far as it was readable."""
    line = stage.control
    number = line.next() + 41
    stage.put(line, Request("PING").frames(line.client, number, change))
    reply = refused(line.receive(), "INVALID_ARGUMENT", "UNIMPLEMENTED")
    who, which = line.client if client else reply.client, number if sequence else 0
    require((reply.client, reply.sequence) == (who, which), f"client {who[:4].hex()}…, sequence {which}", show(reply))


# --- what msgpack leaves open, by number -----------------------------------------------------------------------------


@suite.family(_wrong, "4.1")
def keys_are_str_and_unique() -> Rows:
    """4.1"""
    demand = "Keys of maps are str"
    for name, key in (("int", 1), ("bin", b"v"), ("nil", None), ("true", True), ("float", 1.5)):
        yield f"{name}-key-in-the-header", demand, _PING, _renamed("v", key)
        yield f"{name}-key-in-fields", demand, _PING, _set("fields", {key: 1})
        yield f"{name}-key-in-a-field", demand, Request("OPEN", {"dimension": 2, "settings": {key: 1}})
    twice = "A key does not come twice in a map"
    yield "key-twice-in-the-header", twice, _PING, lambda h: b"\x87" + pack(h)[1:] + b"\xa1v\x01"
    hello = Request("HELLO", {"agent": "a"})
    yield "key-twice-in-fields", twice, hello, _raw(b"\x81\xa5agent\xa1a", b"\x82\xa5agent\xa1a\xa5agent\xa1a")
    yield "key-twice-in-a-field", twice, _setting(1), _raw(b"\x81\xa1a\x01", b"\x82\xa1a\x01\xa1a\x01")
    yield (
        "key-twice-in-an-array-of-maps",
        twice,
        _setting([{"b": 1}]),
        _raw(b"\x81\xa1b\x01", b"\x82\xa1b\x01\xa1b\x02"),
    )


def _renamed(old: str, new: Any) -> Change:
    return lambda header: {new if name == old else name: value for name, value in header.items()}


@suite.family(_wrong, "4.2")
def text_is_utf_8() -> Rows:
    """4.2"""
    demand = "str is valid UTF-8"
    bad = {"ff": b"\xff", "overlong": b"\xc0\xaf", "surrogate": b"\xed\xa0\x80", "cut": b"\xc3", "lone-80": b"\x80"}
    for name, raw in bad.items():
        text = bytes([0xA0 + len(raw)]) + raw
        yield f"{name}-in-a-field", demand, Request("HELLO", {"agent": "@"}), _raw(b"\xa1@", text)
        yield f"{name}-in-a-key", demand, _setting(1), _raw(b"\xa1a\x01", text + b"\x01")
    yield "ff-in-the-type", demand, _PING, _raw(b"\xa4PING", b"\xa4PIN\xff")
    demand = "str and bin are different types"
    yield "str-for-bin", demand, Request("PROBE", {"session": "0" * 32, "token": "0" * 32})
    yield "bin-for-str", demand, Request("PROBE", {"session": b"0" * 32, "token": b"0" * 32})


@suite("4.2")
def text_of_many_planes(stage: Stage) -> None:
    """Valid UTF-8 with one to four bytes per character is accepted."""
    answered(stage.ask(Request("HELLO", {"agent": "aé€😀\0"})), "WELCOME")


@suite.family(_wrong, "4.3")
def no_extensions() -> Rows:
    """4.3"""
    forms = {
        "fixext-1": b"\xd4\x05\0", "fixext-2": b"\xd5\x05\0\0", "fixext-4": b"\xd6\x05" + bytes(4),
        "fixext-8": b"\xd7\x05" + bytes(8), "fixext-16": b"\xd8\x05" + bytes(16), "ext-8": b"\xc7\x03\x05" + bytes(3),
        "ext-8-empty": b"\xc7\x00\x05", "ext-16": b"\xc8\x00\x03\x05" + bytes(3),
        "ext-32": b"\xc9\x00\x00\x00\x03\x05" + bytes(3), "timestamp-32": b"\xd6\xff" + bytes(4),
        "timestamp-64": b"\xd7\xff" + bytes(8), "timestamp-96": b"\xc7\x0c\xff" + bytes(12),
    }  # fmt: skip
    demand = "Extension types, timestamps among them, do not occur"
    for name, raw in forms.items():
        yield f"{name}-in-a-map", demand, _setting(1), _raw(b"\xa1a\x01", b"\xa1a" + raw)
        yield f"{name}-as-a-field", demand, Request("HELLO", {"agent": "@"}), _raw(b"\xa1@", raw)


_INTEGERS = {
    "fixint": b"\x21", "uint-8": b"\xcc\x21", "uint-16": b"\xcd\x00\x21", "uint-32": b"\xce" + (33).to_bytes(4, "big"),
    "uint-64": b"\xcf" + (33).to_bytes(8, "big"), "int-8": b"\xd0\x21", "int-16": b"\xd1\x00\x21",
    "int-32": b"\xd2" + (33).to_bytes(4, "big"), "int-64": b"\xd3" + (33).to_bytes(8, "big"),
}  # fmt: skip


@suite("4.4", {f"sequence-as-{name}": (raw,) for name, raw in _INTEGERS.items()})
def encodings_of_integers(stage: Stage, raw: bytes) -> None:
    """Any msgpack encoding of an integer is admitted."""
    answered(stage.ask(_PING, sequence=33, change=_raw(b"sequence\x21", b"sequence" + raw)), "PONG")


@suite.family(_wrong, "4.4")
def integers() -> Rows:
    """4.4"""
    demand = "Integers are in −2⁶³ … 2⁶³−1"
    for name, value in (("2-63", 2**63), ("2-64-1", 2**64 - 1)):
        yield f"{name}-as-sequence", demand, _PING, _set("sequence", value)
        yield f"{name}-in-a-map", demand, _setting(value)
        yield f"{name}-as-a-field", demand, Request("OPEN", {"dimension": 2, "bytes_reserved": value})
        yield f"{name}-in-an-array", demand, Request("HELLO", {"versions": [[1, value]]})
    others: dict[str, Any] = {"float": 2.0, "true": True, "false": False}
    for name, value in others.items():
        demand = f"{name} is not an integer"
        yield f"{name}-for-an-integer", demand, Request("OPEN", {"dimension": value})
        yield f"{name}-in-an-array-of-integers", demand, Request("HELLO", {"versions": [[value, 0]]})


@suite("4.4")
def largest_sequence(stage: Stage) -> None:
    """2⁶³−1 is a sequence."""
    answered(stage.ask(_PING, sequence=2**63 - 1), "PONG")


@suite.family(_wrong, "4.6")
def numbers_are_finite() -> Rows:
    """4.6"""
    values = {"nan": float("nan"), "infinity": float("inf"), "minus-infinity": float("-inf")}
    demand = "A float in a request is finite"
    code = "INVALID_ARGUMENT.NONFINITE"
    for name, value in values.items():
        yield f"{name}-64-bits", demand, _setting(value), None, code
        narrow = b"\xca" + struct.pack(">f", value)
        yield f"{name}-32-bits", demand, _setting(1), _raw(b"\xa1a\x01", b"\xa1a" + narrow), code
        yield f"{name}-nested", demand, _setting([{"b": [value]}]), None, code


@suite.family(_wrong, "4.8")
def one_map() -> Rows:
    """4.8"""
    demand = "Nothing follows the map in frame 0"
    tails = {"nil": b"\xc0", "zero-byte": b"\0", "map": b"\x80", "one": b"\x01", "long-text": b"\xa5after"}
    for name, tail in tails.items():
        yield f"{name}-behind-the-map", demand, _PING, _bytes(lambda raw, t=tail: raw + t)
    yield "itself-behind-the-map", demand, _PING, _bytes(lambda raw: raw * 2)
    others = {"array": pack([1]), "text": pack("x"), "nil": b"\xc0", "nothing": b"", "c1": b"\xc1"}
    for name, other in others.items():
        demand = "Frame 0 is one map"
        yield f"{name}-instead-of-the-map", demand, _PING, _bytes(lambda _, o=other: o)
    for cut in (1, 2, 9, 30):
        demand = "Frame 0 is a whole map"
        yield f"{cut}-bytes-cut-off", demand, _PING, _bytes(lambda raw, c=cut: raw[:-c])


def _bytes(change: Callable[..., bytes]) -> Change:
    """Change frame 0 after it is packed."""
    return lambda header: change(pack(header))


@suite.family(_wrong, "4.9")
def bounds() -> Rows:
    """4.9, section 6"""

    def nested(levels: int) -> Any:
        value: Any = 1
        for _ in range(levels):
            value = [value]
        return value

    demand = "12 levels of nesting, the header's own map being level 1"
    yield "12-levels", demand, _setting(nested(9)), None, "INVALID_ARGUMENT.SETTINGS"
    yield "13-levels", demand, _setting(nested(10))
    yield "300-levels", demand, _PING, lambda _: b"\x91" * 300
    yield "60000-levels", demand, _PING, lambda _: b"\x91" * 60_000
    many = {f"k{number}": 0 for number in range(257)}
    demand = "256 items in one map or array"
    items = Request("OPEN", {"dimension": 2, "settings": many})
    yield "257-items-in-a-map", demand, items, None, _HEADER, "RESOURCE_EXHAUSTED.BYTES"
    fewer = Request("OPEN", {"dimension": 2, "settings": dict.fromkeys(list(many)[:256], 0)})
    yield "256-items-in-a-map", demand, fewer, None, "INVALID_ARGUMENT.SETTINGS"
    items = Request("HELLO", {"features": ["x"] * 257})
    yield "257-items-in-an-array", demand, items, None, _HEADER, "RESOURCE_EXHAUSTED.BYTES"
    announced = {"array": b"\xdd\xff\xff\xff\xff", "map": b"\xdf\xff\xff\xff\xff", "text": b"\xdb\xff\xff\xff\xff",
                 "binary": b"\xc6\xff\xff\xff\xff", "array-16": b"\xdc\xff\xff", "map-16": b"\xde\xff\xff"}  # fmt: skip
    demand = "What a header announces is bounded before it is there"
    for name, raw in announced.items():
        yield f"huge-{name}-announced", demand, _setting(1), _raw(b"\xa1a\x01", b"\xa1a" + raw)


@suite("4.9")
def _256_items_in_an_array(stage: Stage) -> None:
    """256 items in one array are accepted."""
    answered(stage.ask(Request("HELLO", {"features": ["x"] * 256})), "WELCOME")
