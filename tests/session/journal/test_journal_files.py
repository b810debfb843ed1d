"""Reads of a journal's files: whole files or small parts, never writes, and all files are closed."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.session.journal.files import (
    read_journal,
    read_ledger,
    read_stored_state,
    verified_state,
    view_slot,
)
from mesh_motion_server.session.journal.filesystem import PosixFileSystem
from mesh_motion_server.session.journal.journal import Journal
from mesh_motion_server.session.journal.records import PAGE, pack_record
from tests.faults.model_files import ModelFiles
from tests.faults.power_loss import FOLDER, FOUNDATION, entry_of, state_of

CAPACITY = 64 * PAGE


class Shown(ModelFiles):
    """Forbids opening a file for writing, once this is switched on."""

    closed_to_writers = False

    def open(self, path: Path, *, writable: bool = True) -> int:
        assert not (writable and self.closed_to_writers)
        return super().open(path, writable=writable)


def lived(steps: int, *, capacity: int = CAPACITY, receipt: bytes = b"receipt") -> Shown:
    files = Shown()
    journal = Journal.create(FOLDER, files, replace(FOUNDATION, record_area=8 * PAGE), capacity=capacity)
    for step in range(1, steps + 1):
        journal.store(replace(entry_of(step), receipt=receipt), state_of(step))
    journal.close()
    files.closed_to_writers = True
    return files


@pytest.mark.parametrize("steps", range(20))
def test_a_list_finds_the_last_step_however_much_of_the_manifest_is_read_at_first(steps: int) -> None:
    assert read_ledger(FOLDER, lived(steps)).step == steps


@pytest.mark.parametrize("size", [4000, 5000, 20_000])
@pytest.mark.parametrize("steps", [1, 2, 3, 4, 5, 12])
def test_a_record_that_is_cut_off_by_what_is_read_at_first_is_read_whole(steps: int, size: int) -> None:
    files = lived(steps, capacity=128 * PAGE, receipt=bytes(size))
    assert read_ledger(FOLDER, files).step == steps
    assert read_journal(FOLDER, files).ledger.step == steps


def test_files_that_were_read_are_given_back() -> None:
    files = lived(3)
    found = read_journal(FOLDER, files)
    read_ledger(FOLDER, files)
    read_stored_state(FOLDER, files, found.ledger)
    assert files.handles == {}


@pytest.mark.parametrize("read", [read_journal, read_ledger])
def test_a_journal_that_is_not_there_is_reported(read: Any) -> None:
    with pytest.raises(DataLoss, match="the journal cannot be read"):
        read(FOLDER, ModelFiles())


def test_a_stored_state_is_verified(tmp_path: Path) -> None:
    files = PosixFileSystem()
    journal = Journal.create(tmp_path, files, FOUNDATION, capacity=CAPACITY)
    read_stored_state(tmp_path, files, journal.ledger)
    for step in (1, 2):
        journal.store(entry_of(step), state_of(step))
    read_stored_state(tmp_path, files, journal.ledger)
    slot = tmp_path / "slot-0"
    slot.write_bytes(slot.read_bytes()[:-1])
    with pytest.raises(DataLoss, match="committed step 2 do not match"):
        read_stored_state(tmp_path, files, journal.ledger)
    slot.unlink()
    with pytest.raises(DataLoss, match="a slot cannot be read"):
        read_stored_state(tmp_path, files, journal.ledger)
    journal.close()


def test_where_no_state_is_stored_none_is_verified(tmp_path: Path) -> None:
    journal = Journal.create(tmp_path, PosixFileSystem(), FOUNDATION, capacity=CAPACITY)
    for read in (journal.read_state, lambda: verified_state(bytes(FOUNDATION.state_bytes), journal.ledger)):
        with pytest.raises(DataLoss, match="no state is stored yet"):
            read()
    journal.close()


def slot_with(record: bytes, state: Any, folder: Path) -> Any:
    path = folder / "slot"
    path.write_bytes(record.ljust(FOUNDATION.record_area, b"\0") + state.tobytes())
    return view_slot(path, PosixFileSystem(), FOUNDATION)


def test_a_slot_verifies_with_the_state_that_its_record_names_only(tmp_path: Path) -> None:
    record = pack_record(1, bytes(32), entry_of(1).as_body())
    whole = slot_with(record, state_of(1), tmp_path)
    assert whole.state_verifies()
    assert not whole.blank
    assert not slot_with(record, state_of(2), tmp_path).state_verifies()
    assert not slot_with(record, state_of(1)[1:], tmp_path).state_verifies()
    torn = slot_with(record[:50], state_of(1), tmp_path)
    assert (torn.record, torn.blank, torn.state_verifies()) == (None, False, False)
    blank = slot_with(b"", np.zeros(0), tmp_path)
    assert (blank.record, blank.blank, blank.state_verifies()) == (None, True, False)
    stateless = entry_of(1).as_body() | {"kind": "epoch", "epoch": 2}
    assert not slot_with(pack_record(1, bytes(32), stateless), state_of(1), tmp_path).state_verifies()
