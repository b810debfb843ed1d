"""Files that a crash can leave, and files that only damage can cause."""

from typing import Any

import pytest
from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.session.journal.ledger import Commit, Foundation, Ledger
from mesh_motion_server.session.journal.records import FAMILY, PAGE, Record, pack_record, unpack_record
from mesh_motion_server.session.journal.recovery import SlotView, examine, read_chain

CAPACITY = 12 * PAGE
FOUNDATION = Foundation("0" * 32, b"s", b"m", 1, 1, PAGE)
BLANK = SlotView(None, blank=True, state_verifies=lambda: False)
DIRTY = SlotView(None, blank=False, state_verifies=lambda: False)


def chain(*kinds: str) -> list[bytes]:
    """Records of these kinds after a "build"."""
    bodies: list[dict[str, Any]] = [{"kind": "build", **FOUNDATION.as_body(), "capacity": CAPACITY, "epoch": 1}]
    step, epoch = 0, 1
    for kind in kinds:
        step, epoch = step + (kind == "commit"), epoch + (kind == "epoch")
        bodies.append(Commit(step, b"d", (), b"").as_body() if kind == "commit" else {"kind": "epoch", "epoch": epoch})
    packed: list[bytes] = []
    previous = bytes(32)
    for sequence, body in enumerate(bodies):
        packed.append(pack_record(sequence, previous, body))
        previous = record_of(packed[-1]).checksum
    return packed


def record_of(packed: bytes) -> Record:
    record = unpack_record(packed)
    assert record is not None
    return record


def slot(packed: bytes, *, whole: bool = True) -> SlotView:
    return SlotView(record_of(packed), blank=False, state_verifies=lambda: whole)


def judge(records: list[bytes], even: SlotView = BLANK, odd: SlotView = BLANK, tail: bytes = b"") -> Any:
    manifest = (b"".join(records) + tail).ljust(CAPACITY, b"\0")
    return examine(manifest, lambda foundation: (even, odd), keep=8)


PACKED = chain("commit", "epoch", "commit")


@pytest.mark.parametrize(
    "found",
    [
        pytest.param(([PACKED[0], PACKED[1][:70] + b"\xff" + PACKED[1][71:], *PACKED[2:]],), id="in the middle"),
        pytest.param((PACKED[:2], slot(PACKED[3]), slot(PACKED[1])), id="a slot knows more"),
        pytest.param((PACKED[:3], DIRTY, slot(PACKED[1]), PACKED[3][:80]), id="record and slot"),
        pytest.param(([PACKED[0], PACKED[2]],), id="a record is missing"),
        pytest.param(([b"\xff" + PACKED[0][1:]],), id="the first record"),
        pytest.param(([],), id="empty"),
    ],
)
def test_damage_is_refused(found: tuple[Any, ...]) -> None:
    with pytest.raises(DataLoss) as caught:
        judge(*found)
    assert caught.value.code == "DATA_LOSS.CHECKSUM"
    assert caught.value.hint


def test_a_manifest_starts_with_what_it_rests_on() -> None:
    with pytest.raises(DataLoss, match="starts with a record of kind 'build' or 'checkpoint', not 'epoch'"):
        Ledger.start(record_of(chain("epoch")[1]))


def test_a_first_record_that_does_not_verify_is_damage_or_another_format() -> None:
    damaged = bytearray(chain()[0])
    damaged[100] ^= 1
    with pytest.raises(DataLoss, match="first record") as caught:
        read_chain(bytes(damaged))
    assert caught.value.code == "DATA_LOSS.CHECKSUM"
    other = FAMILY + b"\x63\n\0"
    with pytest.raises(DataLoss, match="format 99") as caught:
        read_chain(other)
    assert caught.value.code == "UNIMPLEMENTED.VERSION"
    with pytest.raises(DataLoss, match="first record"):
        read_chain(other[:8])
