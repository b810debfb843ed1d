"""Frame 0 to the byte: headers that are just admitted, and headers that are just refused."""

import sys

import msgpack
import pytest
from mesh_motion_protocol.errors import ProtocolError
from mesh_motion_protocol.header import pack, unpack
from mesh_motion_protocol.limits import CONTAINER_ITEMS, HEADER_BYTES, HEADER_DEPTH


def filled(size: int) -> dict[str, str]:
    empty = len(msgpack.packb({"a": "x" * HEADER_BYTES})) - HEADER_BYTES
    return {"a": "x" * (size - empty)}


def nested(depth: int) -> dict[str, object]:
    inner: dict[str, object] = {}
    for _ in range(depth - 1):
        inner = {"a": inner}
    return inner


def refused(frame: bytes) -> str:
    with pytest.raises(ProtocolError) as caught:
        unpack(frame)
    return caught.value.code


def test_the_largest_header_is_admitted_and_no_larger_one() -> None:
    header = filled(HEADER_BYTES - 2)  # its length takes two bytes less than the one that was measured
    packed = pack(header)
    largest = pack(filled(HEADER_BYTES - 2 + HEADER_BYTES - len(packed)))
    assert len(largest) == HEADER_BYTES
    assert len(unpack(largest)["a"]) == len(filled(HEADER_BYTES - 2 + HEADER_BYTES - len(packed))["a"])
    larger = filled(HEADER_BYTES - 1 + HEADER_BYTES - len(packed))
    with pytest.raises(ProtocolError) as caught:
        pack(larger)
    assert caught.value.code == "RESOURCE_EXHAUSTED.BYTES"
    assert refused(msgpack.packb(larger)) == "RESOURCE_EXHAUSTED.BYTES"


def test_as_many_items_and_levels_as_the_limits_and_no_more() -> None:
    items = {f"k{number}": number for number in range(CONTAINER_ITEMS)}
    for good in (items, {"a": list(range(CONTAINER_ITEMS))}, nested(HEADER_DEPTH)):
        assert unpack(pack(good)) == good
    for bad in (items | {"one": 1}, {"a": list(range(CONTAINER_ITEMS + 1))}, nested(HEADER_DEPTH + 1)):
        with pytest.raises(ProtocolError):
            pack(bad)
        assert refused(msgpack.packb(bad)).startswith(("INVALID_ARGUMENT.HEADER", "RESOURCE_EXHAUSTED.BYTES"))


@pytest.mark.parametrize("length", [0, 1, 8])
def test_no_extension_of_any_length(length: int) -> None:
    extended = b"\x81\xa1a" + b"\xc7" + bytes([length, 5]) + bytes(length)
    assert msgpack.unpackb(extended) == {"a": msgpack.ExtType(5, bytes(length))}
    assert refused(extended) == "INVALID_ARGUMENT.HEADER"


@pytest.mark.parametrize(
    "whole", [{"a": 1, "b": [{"c": None}], "d": {"e": b"f", "g": 0.5}}, {"a" * 40: {"b" * 300: []}}]
)
def test_a_header_that_ends_early_or_late_is_refused(whole: dict[str, object]) -> None:
    packed = pack(whole)
    for form in (packed, memoryview(packed)):
        assert unpack(form) == whole
    for length in range(len(packed)):
        assert refused(packed[:length]) == "INVALID_ARGUMENT.HEADER"
    assert refused(packed + b"\xc0") == "INVALID_ARGUMENT.HEADER"


def test_arrays_and_maps_of_every_form_of_length() -> None:
    """Maps of up to 15 items, and larger ones with 2 bytes of length or, though it is not the shortest, 4."""
    for items in (0, 1, 15, 16, CONTAINER_ITEMS):
        header = {"a": list(range(items)), "b": {str(number): "x" * number for number in range(items)}}
        assert unpack(msgpack.packb(header)) == header
    assert unpack(b"\xdf\0\0\0\1\xdb\0\0\0\1a\xdd\0\0\0\1\xc3") == {"a": [True]}


def test_no_key_is_interned_however_deep_it_is() -> None:
    """Python 3.12.0 to 3.12.6 never frees an interned string, so ever new keys would fill the memory."""

    def is_interned(text: str) -> bool:
        return sys.intern("".join(text)) is text  # the one that is there already, or this copy

    header = unpack(msgpack.packb({"outer key of a test": [{"inner key of a test": {"innermost key of a test": 1}}]}))
    (outer,) = header
    (inner,) = header[outer][0]
    (innermost,) = header[outer][0][inner]
    again = msgpack.unpackb(msgpack.packb({"key of another test": 1}))
    assert is_interned(next(iter(again)))  # the reason why unpackb does not read a client's bytes
    assert not any(is_interned(key) for key in (outer, inner, innermost))
