"""The real journal on a file system that loses power between any two operations: the row `power-loss`.

The tests of the check at the end seed a bug and require that the same campaign finds it.
"""

from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import pytest
from believing_journal import believe_every_slot
from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.session.journal import journal as journal_module
from mesh_motion_server.session.journal.journal import Journal
from mesh_motion_server.session.journal.ledger import Commit, Ledger
from mesh_motion_server.session.journal.relaxed import RelaxedKeeper
from tests.faults.check import BrokenPromise
from tests.faults.power_loss import explore, fail_each

SCRIPT = "cceccccccoec"
#: With the further commands of the other levels: "f" catches up, stores what was logged.
LONG_SCRIPT = "ccecfcccccocefcc"
OTHERS = ("replay", "relaxed")


def test_no_step_is_lost_whose_state_a_thread_writes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal_module, "_LARGE_STATE", 0)
    assert explore(SCRIPT, Random(1)) > 500
    assert fail_each(SCRIPT, Random(1)) > 50


# --- tests of the test: each seeded bug must be found ----------------------------------------------------------------


class Unsynced:
    """A file system that does not sync files, or folders, of some names."""

    def __init__(self, files: Any, *names: str) -> None:
        self._files, self._names = files, names
        self._open: dict[int, str] = {}

    def __getattr__(self, name: str) -> Any:
        return getattr(self._files, name)

    def _remember(self, handle: int, path: Path) -> int:
        self._open[handle] = path.name
        return handle

    def create(self, path: Path, size: int) -> int:
        return self._remember(self._files.create(path, size), path)

    def open(self, path: Path, *, writable: bool = True) -> int:
        return self._remember(self._files.open(path, writable=writable), path)

    def sync(self, handle: int) -> None:
        if self._open[handle] not in self._names:
            self._files.sync(handle)

    def sync_folder(self, path: Path) -> None:
        if "folder" not in self._names:
            self._files.sync_folder(path)


class OneSlot:
    def __init__(self, files: Any) -> None:
        self._files = files

    def __getattr__(self, name: str) -> Any:
        return getattr(self._files, name)

    @staticmethod
    def _only(path: Path) -> Path:
        return path.with_name("slot-0") if path.name == "slot-1" else path

    def create(self, path: Path, size: int) -> int:
        return self._files.create(self._only(path), size)  # type: ignore[no-any-return]

    def open(self, path: Path, *, writable: bool = True) -> int:
        return self._files.open(self._only(path), writable=writable)  # type: ignore[no-any-return]


FOUND = (BrokenPromise, DataLoss, OSError)


@pytest.mark.parametrize("names", [("slot-0", "slot-1"), ("manifest",), ("manifest.new",), ("folder",)])
def test_a_missing_sync_is_found(names: tuple[str, ...]) -> None:
    with pytest.raises(FOUND):
        explore(SCRIPT, Random(1), wrap=lambda files: Unsynced(files, *names))


def test_a_single_slot_is_found() -> None:
    with pytest.raises(FOUND):
        explore(SCRIPT, Random(1), wrap=OneSlot)


@pytest.mark.parametrize("level", OTHERS)
@pytest.mark.parametrize("names", [("slot-0", "slot-1"), ("manifest",)])
def test_a_missing_sync_is_found_at_the_other_levels(names: tuple[str, ...], level: str) -> None:
    with pytest.raises(FOUND):
        explore(LONG_SCRIPT, Random(1), wrap=lambda files: Unsynced(files, *names), level=level)


@pytest.mark.parametrize("level", OTHERS)
def test_a_state_over_the_only_good_one_is_found(level: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Ledger, "next_slot", property(lambda self: self.snapshot.slot if self.snapshot else 1))
    with pytest.raises(FOUND):
        explore(LONG_SCRIPT, Random(1), level=level)


def test_a_durable_step_answered_before_its_sync_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(RelaxedKeeper, "durable_after", lambda self, step: step)
    with pytest.raises(BrokenPromise, match="was promised"):
        explore(LONG_SCRIPT, Random(1), level="relaxed")


def test_replies_of_steps_that_are_passed_over_are_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = Journal.store
    monkeypatch.setattr(Journal, "store", lambda self, entry, state, earlier=(): honest(self, entry, state))
    with pytest.raises(BrokenPromise, match="replies are kept"):
        explore(LONG_SCRIPT, Random(1), level="relaxed")


def test_inputs_that_a_checkpoint_forgets_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = Ledger.checkpoint_body

    def forgetful(self: Ledger, capacity: int) -> Any:
        return replace(self, commits=tuple(replace(c, boundary=None) for c in self.commits))._honest(capacity)  # type: ignore[attr-defined]

    monkeypatch.setattr(Ledger, "_honest", honest, raising=False)
    monkeypatch.setattr(Ledger, "checkpoint_body", forgetful)
    with pytest.raises(FOUND):
        explore("ccecceccecceccec", Random(1), level="replay")


def test_a_log_that_is_stored_too_late_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """A step that is not logged any more must be in a slot."""

    def hasty(self: Journal, state: Any) -> None:
        last, slot = self.ledger.commits[-1], self.ledger.next_slot
        body = {"kind": "snapshot", "step": last.step, "digest": last.digest, "slot": slot}
        packed = self._fitting_record(body)
        self._append(packed)
        self._write_slot(slot, packed, state)

    monkeypatch.setattr(Journal, "snapshot", hasty)
    with pytest.raises(FOUND):
        explore("cfccfcco", Random(1), level="replay")


def test_a_missing_slot_checksum_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    believe_every_slot(monkeypatch)
    with pytest.raises(FOUND):
        explore(SCRIPT, Random(1))


def test_a_record_written_before_its_slot_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def hasty(self: Journal, entry: Commit, state: Any) -> None:
        packed, slot = self._fitting_record(entry.as_body()), self.ledger.next_slot
        self._append(packed)
        self._write_slot(slot, packed, state)

    monkeypatch.setattr(Journal, "store", hasty)
    with pytest.raises(FOUND):
        explore(SCRIPT, Random(1))


def test_trusting_the_page_cache_after_a_failed_sync_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def trusting(self: Journal, found: Any) -> None:
        for record in found.completion:
            packed = journal_module.pack_record(record.sequence, record.previous, record.body)
            self._files.write(self._handles[0], self._end, packed)
            self._files.sync(self._handles[0])
            self._end += len(packed)

    monkeypatch.setattr(Journal, "_settle", trusting)
    with pytest.raises(FOUND):
        fail_each(SCRIPT, Random(1))
