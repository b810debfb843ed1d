"""Damage to the journal: the findings of the check, and detection of a journal that trusts damaged data."""

import pytest
from believing_journal import believe_every_slot

from mesh_motion_server.session.journal.records import PAGE
from mesh_motion_server.settings import DURABILITY_LEVELS
from tests.faults.check import BrokenPromise
from tests.faults.journal_damage import FOLDER, STEPS, damage, read_back, small_journal


@pytest.mark.parametrize("level", DURABILITY_LEVELS)
def test_the_whole_journal_reads_as_it_was_written(level: str) -> None:
    assert read_back(small_journal(level)) == STEPS


@pytest.mark.parametrize("level", DURABILITY_LEVELS)
def test_every_kth_byte_of_each_file(level: str) -> None:
    contents = small_journal(level)
    outcomes = [damage(contents, path, at, at % 8) for path, data in contents.items() for at in range(0, len(data), 13)]
    assert set(outcomes) == {-1, STEPS}
    assert min(outcomes.count(-1), outcomes.count(STEPS)) > 100


def test_a_logged_commit_that_vanishes_with_its_last_byte_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a witness, damage to the last record looks like a write that a crash has cut."""
    contents = small_journal("replay")
    manifest = FOLDER / "manifest"
    assert damage(contents, manifest, STEPS * PAGE + 60, 3) == -1
    monkeypatch.setattr("mesh_motion_server.session.journal.recovery.has_witness", lambda foundation: False)
    assert damage(contents, manifest, STEPS * PAGE + 60, 3) == STEPS - 1


def test_a_journal_that_verifies_no_state_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    contents = small_journal()
    believe_every_slot(monkeypatch)
    newest = FOLDER / f"slot-{STEPS % 2}"
    with pytest.raises(BrokenPromise, match="a wrong array is read as step 3"):
        damage(contents, newest, PAGE + 9, 3)
