"""Units of a connection are the same for any division of its bytes."""

import pytest

from tests.faults.zmtp_stream import Stream

GREETING = b"\xff" + bytes(63)
COMMAND = b"\x04\x03abc"
SHORT = b"\x00\x02hi"
MULTIPART = b"\x01\x01a" + b"\x03" + (300).to_bytes(8, "big") + bytes(300) + b"\x02" + (5).to_bytes(8, "big") + b"12345"
ALL = GREETING + COMMAND + SHORT + MULTIPART + COMMAND + SHORT
UNITS = [("command", COMMAND), ("message", SHORT), ("message", MULTIPART), ("command", COMMAND), ("message", SHORT)]


@pytest.mark.parametrize("size", [1, 3, 10, 63, 64, 65, 200, 1000])
def test_units(size: int) -> None:
    stream = Stream()
    units = [unit for start in range(0, len(ALL), size) for unit in stream.feed(ALL[start : start + size])]
    greeting = [data for kind, data in units if kind == "greeting"]
    assert b"".join(greeting) == GREETING
    assert units[len(greeting) :] == UNITS
    assert stream.rest == b""


def test_a_part_of_a_unit_waits() -> None:
    stream = Stream()
    assert len(list(stream.feed(GREETING[:10]))) == 1
    assert len(list(stream.feed(GREETING[10:] + MULTIPART[:-1]))) == 1
    assert stream.rest == MULTIPART[:-1]
    assert list(stream.feed(MULTIPART[-1:])) == [("message", MULTIPART)]
