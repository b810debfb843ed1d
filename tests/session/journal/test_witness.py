"""The page that names the last durable record: it is read only if complete, and compared with the last record."""

import hashlib
from dataclasses import replace

from mesh_motion_server.session.journal.ledger import Foundation
from mesh_motion_server.session.journal.records import PAGE, Record
from mesh_motion_server.session.journal.witness import Witness, has_witness, manifest_bytes

WITNESS = Witness(7, b"c" * 32)
LAST = Record(7, b"p" * 32, {"kind": "epoch"}, b"c" * 32, PAGE)


def test_literal_bytes() -> None:
    content = b"MMTAIL\x01\n" + (7).to_bytes(8, "little") + b"c" * 32
    assert WITNESS.pack() == content + hashlib.sha256(content).digest()
    assert Witness.of(LAST) == WITNESS


def test_a_witness_is_read_as_written_and_damage_is_found() -> None:
    packed = WITNESS.pack()
    assert Witness.unpack(packed) == Witness.unpack(packed.ljust(PAGE, b"\0")) == WITNESS
    for offset in range(len(packed)):
        damaged = bytearray(packed.ljust(PAGE, b"\0"))
        damaged[offset] ^= 1
        assert Witness.unpack(bytes(damaged)) is None
        assert Witness.unpack(packed[:offset]) is None
    assert Witness.unpack(bytes(PAGE)) is None
    other = b"MMTAIL\x02\n" + packed[8:48]
    assert Witness.unpack(other + hashlib.sha256(other).digest()) is None


def test_it_agrees_with_a_chain_that_has_its_record() -> None:
    assert WITNESS.agrees(LAST)
    assert WITNESS.agrees(replace(LAST, sequence=8, checksum=b"d" * 32))
    assert not WITNESS.agrees(replace(LAST, checksum=b"d" * 32))
    assert not WITNESS.agrees(replace(LAST, sequence=6))


def test_only_a_level_that_logs_has_one() -> None:
    full = Foundation("0" * 32, b"s", b"m", 1, 1, PAGE)
    for level, pages in (("full", 4), ("replay", 5), ("relaxed", 4)):
        foundation = replace(full, durability=level)
        assert has_witness(foundation) == (level == "replay")
        assert manifest_bytes(foundation, 4 * PAGE) == pages * PAGE
