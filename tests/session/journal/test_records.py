"""Records are whole pages, and a damaged one is not read."""

import hashlib

import msgpack
from hypothesis import given
from hypothesis import strategies as st

from mesh_motion_server.session.journal.records import FAMILY, PAGE, find_record, pack_record, unpack_record


def test_packed_records_are_unpacked() -> None:
    for size in (0, 3000, 4000, 4096, 20_000):
        body = {"kind": "commit", "receipt": bytes(size)}
        packed = pack_record(7, b"q" * 32, body)
        assert len(packed) % PAGE == 0
        record = unpack_record(b"\0" * PAGE + packed, PAGE)
        assert (record.sequence, record.previous, record.body) == (7, b"q" * 32, body)
        assert (record.kind, record.length) == ("commit", len(packed))


@given(data=st.data())
def test_no_damaged_record_is_read(data: st.DataObject) -> None:
    packed = pack_record(1, bytes(32), {"kind": "epoch", "epoch": 9})
    used = len(packed.rstrip(b"\0"))
    offset = data.draw(st.integers(0, used - 1))
    damaged = bytearray(packed)
    damaged[offset] ^= data.draw(st.integers(1, 255))
    assert unpack_record(bytes(damaged)) is None
    assert unpack_record(packed[:offset]) is None


def test_a_record_is_found_behind_damage_at_page_starts_only() -> None:
    packed = pack_record(1, bytes(32), {"kind": "epoch", "epoch": 9})
    assert find_record(bytes(3 * PAGE) + packed, 0) == 3 * PAGE
    assert find_record(bytes(3 * PAGE + 8) + packed, 0) is None
    assert find_record((FAMILY + b"\x01\n").ljust(2 * PAGE, b"\0"), 0) is None


def test_a_record_follows_by_its_number_and_by_the_checksum_before_it() -> None:
    first = unpack_record(pack_record(1, bytes(32), {"kind": "epoch", "epoch": 9}))
    for sequence, previous, follows in ((2, first.checksum, True), (2, bytes(32), False), (3, first.checksum, False)):
        other = unpack_record(pack_record(sequence, previous, {"kind": "epoch", "epoch": 10}))
        assert other.follows(first) is follows
    newer = unpack_record(pack_record(2, first.checksum, {"kind": "epoch", "epoch": 10}, format=2))
    assert not newer.follows(first)


def test_a_record_that_fills_its_page_to_the_last_byte_is_read() -> None:
    packed = pack_record(1, bytes(32), {"r": bytes(PAGE - 56 - 32 - 6)})
    record = unpack_record(packed)
    assert (len(packed), record.length) == (PAGE, PAGE)
    assert packed[-32:] == record.checksum
    assert find_record(packed, 0) == 0


def test_a_record_of_an_unknown_format_is_none() -> None:
    packed = pack_record(1, bytes(32), {"kind": "epoch", "epoch": 9})
    body = msgpack.packb({"kind": "epoch", "epoch": 9})
    framed = FAMILY + b"\x63\n" + packed[8 : 56 + len(body)]
    assert unpack_record((framed + hashlib.sha256(framed).digest()).ljust(PAGE, b"\0")) is None
