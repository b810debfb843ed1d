"""Which records may follow the others; the rest of the ledger is tested through journals."""

from dataclasses import replace
from typing import Any

import pytest
from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.session.journal.ledger import BoundaryInput, Commit, Foundation, Ledger
from mesh_motion_server.session.journal.records import PAGE, Record, pack_record, unpack_record
from mesh_motion_server.session.journal.replies import RequestId

FULL = Foundation("0" * 32, b"s", b"m", 3, 2, PAGE)
REPLAY = replace(FULL, durability="replay", snapshot_steps=8, log_bytes=1 << 20)
FIRST = {"kind": "build", "capacity": 8 * PAGE, "epoch": 1}


def commit(step: int, boundary: BoundaryInput | None = None) -> dict[str, Any]:
    request = RequestId(b"c" * 16, step, b"content")
    return Commit(step, b"digest %d" % step, (request,), b"receipt", boundary).as_body()


def logged(step: int) -> dict[str, Any]:
    return commit(step, BoundaryInput("committed", b"rows", "the model"))


def snapshot(step: int, slot: int) -> dict[str, Any]:
    return {"kind": "snapshot", "step": step, "digest": b"digest %d" % step, "slot": slot}


def record(body: dict[str, Any], format: int, sequence: int = 7) -> Record:
    made = unpack_record(pack_record(sequence, bytes(32), body, format))
    assert made is not None
    return made


def after(foundation: Foundation, *bodies: dict[str, Any]) -> Ledger:
    ledger = Ledger.start(record(FIRST | foundation.as_body(), foundation.format))
    for body in bodies:
        ledger = ledger.after(record(body, foundation.format), 8)
    return ledger


@pytest.mark.parametrize(
    ("foundation", "body"),
    [
        pytest.param(FULL, commit(3), id="a step is missing"),
        pytest.param(FULL, commit(1), id="a step comes twice"),
        pytest.param(FULL, {"kind": "epoch", "epoch": 1}, id="an epoch comes twice"),
        pytest.param(FULL, {"kind": "epoch", "epoch": 0}, id="an earlier epoch"),
        pytest.param(FULL, {"kind": "epoxy", "epoch": 2}, id="an unknown kind"),
        pytest.param(FULL, FIRST | FULL.as_body(), id="a first record"),
        pytest.param(REPLAY, commit(2) | {"slot": 0, "since": 0, "earlier": []}, id="a batch that begins elsewhere"),
        pytest.param(REPLAY, snapshot(2, 0), id="another state than the last one"),
        pytest.param(REPLAY, logged(2) | {"kind": "surprise"}, id="a commit under another name"),
        pytest.param(REPLAY, snapshot(1, 0) | {"kind": "surprise"}, id="a snapshot under another name"),
    ],
)
def test_a_record_that_does_not_follow_is_refused(foundation: Foundation, body: dict[str, Any]) -> None:
    first = commit(1) if foundation is FULL else logged(1)
    ledger = after(foundation, first)
    with pytest.raises(DataLoss, match=r"record 9 of kind .* does not follow step 1, epoch 1") as caught:
        ledger.after(record(body, foundation.format, sequence=9), 8)
    assert caught.value.details == {"record": 9}


def test_a_snapshot_needs_a_commit() -> None:
    with pytest.raises(DataLoss, match="does not follow step 0"):
        after(REPLAY, snapshot(0, 1))
