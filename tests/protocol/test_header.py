"""Frame 0 to the byte: what is just admitted, what is just refused."""

from __future__ import annotations

import msgpack
import pytest
from mesh_motion_protocol.errors import ProtocolError
from mesh_motion_protocol.header import pack, unpack
from mesh_motion_protocol.limits import CONTAINER_ITEMS, HEADER_BYTES, HEADER_DEPTH


def filled(size: int) -> dict[str, str]:
    """A map that takes so many bytes."""
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
