"""The journal on a model of a file system: effects of a failure, and repairs, syncs and releases while opening."""

from contextlib import suppress
from dataclasses import replace
from typing import Any

import pytest
from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.session.journal.files import read_journal
from mesh_motion_server.session.journal.journal import Journal
from mesh_motion_server.session.journal.ledger import Commit
from mesh_motion_server.session.journal.records import PAGE
from tests.faults.model_files import FailingFiles, ModelFiles
from tests.faults.power_loss import FOLDER, boundary_of, entry_of, foundation_of, state_of


def lived(level: str, steps: int = 2, pages: int = 6) -> tuple[Journal, FailingFiles]:
    """A journal of a level after this number of steps; with "replay" they are logged."""
    files = FailingFiles(ModelFiles(), for_ever=False)
    journal = Journal.create(FOLDER, files, foundation_of(level), capacity=pages * PAGE)
    for step in range(1, steps + 1):
        if level == "replay":
            journal.log(logged(step))
        else:
            journal.store(entry_of(step), state_of(step))
    return journal, files


def logged(step: int) -> Commit:
    return replace(entry_of(step), boundary=boundary_of(step))


OPERATIONS = [
    lambda journal: journal.store(entry_of(3), state_of(3)),
    lambda journal: journal.log(logged(3)),
    lambda journal: journal.snapshot(state_of(2)),
    lambda journal: journal.raise_epoch(),
]


@pytest.mark.parametrize("operation", OPERATIONS, ids=["store", "log", "snapshot", "raise_epoch"])
def test_after_a_failure_nothing_more_is_written(operation: Any) -> None:
    journal, files = lived("replay")
    files.fail_at = files.count + 1
    with pytest.raises(DataLoss) as failed:
        operation(journal)
    assert failed.value.code == "RESOURCE_EXHAUSTED.DISK"
    assert failed.value.details == {"errno": "EIO"}
    for later in OPERATIONS:
        count = files.count
        with pytest.raises(DataLoss, match="frozen since an earlier operation failed") as refused:
            later(journal)
        assert (refused.value.code, files.count) == ("RESOURCE_EXHAUSTED.DISK", count)


def test_a_snapshot_of_the_wrong_size_is_refused_before_anything_is_written() -> None:
    journal, files = lived("replay")
    count = files.count
    with pytest.raises(DataLoss, match="the state of step 2 does not fit its slot"):
        journal.snapshot(state_of(2)[1:])
    assert (journal.frozen, files.count) == (False, count)


@pytest.mark.parametrize("level", ["full", "replay", "relaxed"])
def test_all_files_are_given_back(level: str) -> None:
    journal, files = lived(level, steps=20)
    assert len(files.handles) == 3
    journal.close()
    journal.close()
    Journal.open(FOLDER, files).close()
    assert files.handles == {}


@pytest.mark.parametrize("level", ["full", "replay", "relaxed"])
def test_nothing_that_opening_wrote_is_left_unsynced(level: str) -> None:
    journal, files = lived(level, steps=3)
    journal.close()
    Journal.open(FOLDER, files).close()
    for name in ("manifest", "slot-0", "slot-1"):
        assert files.entries[FOLDER / name].pending == []
    assert [path for path, _ in files.changes if path.name != "manifest.new"] == []


def test_opening_writes_the_content_of_the_page_cache_to_the_disk() -> None:
    """A failed sync may have lost data that reads still show: all of it is written again."""
    for fail_at in range(1, 100):
        journal, files = lived("full", steps=2)
        files.fail_at = files.count + fail_at
        with suppress(DataLoss):
            journal.store(entry_of(3), state_of(3))
        journal.close()
        files.fail_at = None
        again = Journal.open(FOLDER, files)
        again.close()
        for name in ("manifest", f"slot-{again.ledger.snapshot.slot}"):
            assert files.entries[FOLDER / name].disk == files.entries[FOLDER / name].cache
        if not files.failed:
            break
    assert fail_at > 5


def test_a_logged_step_that_was_witnessed_and_is_gone_is_missed() -> None:
    """The page after the records says that record 2 was synced before record 3 was written."""
    journal, files = lived("replay", steps=3)
    journal.close()
    manifest = files.entries[FOLDER / "manifest"].cache
    manifest[3 * PAGE : 4 * PAGE] = bytes(PAGE)
    assert read_journal(FOLDER, files).ledger.step == 2  # as a crash may have left it
    manifest[2 * PAGE : 3 * PAGE] = bytes(PAGE)
    with pytest.raises(DataLoss, match="has a wrong checksum, but it was correct once"):
        read_journal(FOLDER, files)


def test_opening_witnesses_the_last_record() -> None:
    journal, files = lived("replay", steps=2)
    journal.close()
    Journal.open(FOLDER, files).close()
    files.entries[FOLDER / "manifest"].cache[2 * PAGE : 3 * PAGE] = bytes(PAGE)
    with pytest.raises(DataLoss, match="has a wrong checksum, but it was correct once"):
        read_journal(FOLDER, files)


@pytest.mark.parametrize("slot", [0, 1])
def test_opening_cleans_a_slot_that_was_being_written_and_no_other(slot: int) -> None:
    journal, files = lived("full", steps=2 + slot)
    journal.close()
    entries = files.entries
    other = bytes(entries[FOLDER / f"slot-{1 - slot}"].cache)
    entries[FOLDER / f"slot-{slot}"].cache[:PAGE] = b"torn".ljust(PAGE, b"x")
    manifest = entries[FOLDER / "manifest"].cache
    manifest[(2 + slot) * PAGE : (3 + slot) * PAGE] = bytes(PAGE)
    again = Journal.open(FOLDER, files)
    assert again.ledger.step == 1 + slot
    again.close()
    area = again.ledger.foundation.record_area
    assert not any(entries[FOLDER / f"slot-{slot}"].cache[:area])
    assert bytes(entries[FOLDER / f"slot-{1 - slot}"].cache) == other
    assert entries[FOLDER / f"slot-{slot}"].pending == []


@pytest.mark.parametrize("level", ["full", "replay"])
def test_opening_cuts_a_torn_end_off_and_leaves_the_files_as_large_as_they_were(level: str) -> None:
    journal, files = lived(level, steps=2)
    journal.raise_epoch()
    journal.close()
    entries = files.entries
    sizes = {path: len(file.cache) for path, file in entries.items()}
    entries[FOLDER / "manifest"].cache[3 * PAGE + 60 : 3 * PAGE + 62] = b"\xff\xff"
    del entries[FOLDER / "manifest.new"]
    Journal.open(FOLDER, files).close()
    assert {path: len(file.cache) for path, file in entries.items()} == sizes
    assert not any(entries[FOLDER / "manifest"].cache[3 * PAGE : 6 * PAGE])
