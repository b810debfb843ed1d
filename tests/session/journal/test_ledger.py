"""The sum of records: place of the next state, kept commits, and records that may follow."""

from dataclasses import replace
from typing import Any

import pytest
from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.session.journal.ledger import BoundaryInput, Commit, Foundation, Ledger, Snapshot
from mesh_motion_server.session.journal.records import PAGE, Record, pack_record, unpack_record
from mesh_motion_server.session.journal.replies import RequestId

FULL = Foundation("0" * 32, b"s", b"m", 3, 2, PAGE)
REPLAY = replace(FULL, durability="replay", snapshot_steps=8, log_bytes=1 << 20)
RELAXED = replace(FULL, durability="relaxed")
INPUT = BoundaryInput("committed", b"rows", "the model")
CAPACITY = 8 * PAGE


def commit(step: int, boundary: BoundaryInput | None = None) -> Commit:
    return Commit(step, b"digest %d" % step, (RequestId(b"c" * 16, step, b"content"),), b"receipt", boundary)


def logged(step: int) -> dict[str, Any]:
    return commit(step, INPUT).as_body()


def stored(step: int, slot: int, **others: Any) -> dict[str, Any]:
    return commit(step).as_body() | {"slot": slot, "since": step - 1, "earlier": []} | others


def snapshot(step: int, slot: int) -> dict[str, Any]:
    return {"kind": "snapshot", "step": step, "digest": b"digest %d" % step, "slot": slot}


def record(body: dict[str, Any], format: int, sequence: int = 7) -> Record:
    made = unpack_record(pack_record(sequence, bytes(32), body, format))
    assert made is not None
    return made


def started(foundation: Foundation) -> Ledger:
    return Ledger.start(
        record({"kind": "build", **foundation.as_body(), "capacity": CAPACITY, "epoch": 1}, foundation.format)
    )


def after(foundation: Foundation, *bodies: dict[str, Any], keep: int = 8) -> Ledger:
    ledger = started(foundation)
    for body in bodies:
        ledger = ledger.after(record(body, foundation.format), keep)
    return ledger


def again(ledger: Ledger) -> Ledger:
    return Ledger.start(record(ledger.checkpoint_body(CAPACITY), ledger.foundation.format))


def test_keys_of_the_first_record_in_each_format() -> None:
    first = {"session", "spec", "mesh", "nodes", "dimension", "record_area"}
    assert set(FULL.as_body()) == first
    assert set(REPLAY.as_body()) == set(RELAXED.as_body()) == first | {"durability", "snapshot_steps", "log_bytes"}
    assert (FULL.format, REPLAY.format, RELAXED.format) == (1, 2, 2)
    assert FULL.state_bytes == 48
    for foundation in (FULL, REPLAY, RELAXED):
        ledger = started(foundation)
        assert (ledger.foundation, ledger.capacity, ledger.epoch) == (foundation, CAPACITY, 1)
        assert (ledger.step, ledger.commits, ledger.snapshot, ledger.logged, ledger.next_slot) == (0, (), None, (), 1)


def test_in_format_1_every_commit_is_stored_in_the_slot_of_its_step() -> None:
    ledger = started(FULL)
    for step in range(1, 6):
        ledger = ledger.after(record(commit(step).as_body(), 1), 8)
        assert ledger.snapshot == Snapshot(step, b"digest %d" % step, step % 2)
        assert again(ledger).snapshot == ledger.snapshot
        assert (ledger.step, ledger.next_slot, ledger.logged) == (step, 1 - step % 2, ())


def test_logged_commits_are_kept_with_their_input_until_a_state_is_stored() -> None:
    ledger = after(REPLAY, *(logged(step) for step in range(1, 6)), keep=2)
    assert ledger.logged == ledger.commits == tuple(commit(step, INPUT) for step in range(1, 6))
    assert (ledger.snapshot, ledger.next_slot) == (None, 1)
    settled = ledger.after(record(snapshot(5, 1), 2), 2)
    assert (settled.commits, settled.logged) == ((commit(4), commit(5)), ())
    assert (settled.snapshot, settled.next_slot) == (Snapshot(5, b"digest 5", 1), 0)
    behind = settled.after(record(logged(6), 2), 2)
    assert (behind.commits, behind.logged) == ((commit(5), commit(6, INPUT)), (commit(6, INPUT),))
    assert behind.snapshot == settled.snapshot
    for each in (ledger, settled, behind):
        copy = again(each)
        assert (copy.commits, copy.snapshot, copy.epoch) == (each.commits, each.snapshot, each.epoch)


def test_a_batch_brings_the_commits_that_were_passed_over() -> None:
    earlier = [commit(step).as_body() for step in (1, 2)]
    ledger = after(RELAXED, stored(3, 1, since=0, earlier=earlier), stored(4, 0), keep=3)
    assert ledger.commits == (commit(2), commit(3), commit(4))
    assert (ledger.step, ledger.snapshot, ledger.logged) == (4, Snapshot(4, b"digest 4", 0), ())


@pytest.mark.parametrize(
    ("foundation", "body"),
    [
        pytest.param(FULL, commit(3).as_body(), id="a step is missing"),
        pytest.param(FULL, commit(1).as_body(), id="a step comes twice"),
        pytest.param(FULL, {"kind": "epoch", "epoch": 1}, id="an epoch comes twice"),
        pytest.param(FULL, {"kind": "epoch", "epoch": 0}, id="an earlier epoch"),
        pytest.param(FULL, {"kind": "epoxy", "epoch": 2}, id="an unknown kind"),
        pytest.param(FULL, {"kind": "build", **FULL.as_body(), "capacity": CAPACITY, "epoch": 1}, id="a first record"),
        pytest.param(REPLAY, stored(2, 0, since=0), id="a batch that begins elsewhere"),
        pytest.param(REPLAY, snapshot(2, 0), id="another state than the last one"),
        pytest.param(REPLAY, logged(2) | {"kind": "surprise"}, id="a commit under another name"),
        pytest.param(REPLAY, snapshot(1, 0) | {"kind": "surprise"}, id="a snapshot under another name"),
    ],
)
def test_a_record_that_does_not_follow_is_refused(foundation: Foundation, body: dict[str, Any]) -> None:
    first = commit(1).as_body() if foundation is FULL else logged(1)
    ledger = after(foundation, first)
    with pytest.raises(DataLoss, match=r"record 9 of kind .* does not follow step 1, epoch 1") as caught:
        ledger.after(record(body, foundation.format, sequence=9), 8)
    assert caught.value.details == {"record": 9}


def test_a_snapshot_needs_a_commit() -> None:
    with pytest.raises(DataLoss, match="does not follow step 0"):
        after(REPLAY, snapshot(0, 1))


def test_an_epoch_changes_nothing_else() -> None:
    before = after(REPLAY, logged(1))
    ledger = before.after(record({"kind": "epoch", "epoch": 5}, 2), 8)
    assert ledger.epoch == again(ledger).epoch == 5
    assert replace(ledger, epoch=1, last=before.last) == before


def test_a_checkpoint_of_format_1_names_no_snapshot() -> None:
    assert "snapshot" not in after(FULL, commit(1).as_body()).checkpoint_body(CAPACITY)
    assert after(REPLAY).checkpoint_body(CAPACITY)["snapshot"] is None
