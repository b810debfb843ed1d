"""The real journal on a file system that loses power between any two operations.

Each campaign runs one life of a journal (build, commits, epochs, a full manifest), loses power at every operation,
continues from several of the disks that are possible then, sometimes losing power again while it recovers, and checks
that no acknowledged step, reply or epoch is lost and every array is right. The tests of the test at the end seed a bug
and demand that the same campaign finds it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_motion_protocol.digests import state_digest

from mesh_motion_server.errors import JournalError
from mesh_motion_server.session import journal as journal_module
from mesh_motion_server.session import journal_files
from mesh_motion_server.session.journal import Journal
from mesh_motion_server.session.ledger import Commit, Foundation
from mesh_motion_server.session.replies import RequestId

FOLDER = Path("/session")
NODES, DIMENSION, AREA = 300, 2, 8192
FOUNDATION = Foundation("0" * 32, b"s" * 32, b"m" * 32, NODES, DIMENSION, AREA)
SCRIPT = "cceccccccec"
DISKS = 6


def state_of(step: int) -> Any:
    return np.random.default_rng(step).random((NODES, DIMENSION))


def entry_of(step: int) -> Commit:
    request = RequestId(b"c" * 16, step, bytes([step]) * 32)
    return Commit(step, state_digest(step, state_of(step)), (request,), f"receipt {step}".encode())


@dataclass
class Life:
    """One journal's life, and what it acknowledged."""

    files: Any
    built: bool = False
    step: int = 0
    epoch: int = 0
    asked: int = 0
    epochs: list[int] = field(default_factory=list)

    def run(self, script: str) -> None:
        if not self.files.exists(FOLDER / "manifest") and not self.built:
            journal = Journal.create(FOLDER, self.files, FOUNDATION)
            self.built, self.epoch = True, 1
        else:
            journal = Journal.open(FOLDER, self.files)
            self.built = True
            self.check(journal)
        for command in script:
            if command == "c":
                self.asked = self.step + 1
                journal.commit(entry_of(self.asked), state_of(self.asked))
                self.step = self.asked
            else:
                self.epoch = journal.raise_epoch()

    def check(self, journal: Journal) -> None:
        """Nothing acknowledged is lost, nothing is wrong, and what was only asked for is there or not."""
        found = journal.ledger.step
        assert found in (self.step, self.asked), f"step {found}, acknowledged {self.step}, asked {self.asked}"
        if found:
            np.testing.assert_array_equal(journal.read_state(), state_of(found))
        for commit in journal.ledger.commits:
            assert commit == entry_of(commit.step)
        assert len(journal.ledger.commits) == min(found, journal_files.KEPT_COMMITS)
        self.step = found
        epoch = journal.raise_epoch()
        assert epoch > self.epoch, f"epoch {epoch} after {self.epoch} was acknowledged"
        self.epoch = epoch


def campaign(model: Any, wrap: Any = lambda files: files, disks: int = DISKS) -> int:
    """Lose power at every operation; returns how many disks were looked at."""
    whole = model.ModelFiles()
    Life(wrap(whole)).run(SCRIPT)
    looked_at = 0
    for crash_at in range(len(whole.operations)):
        for disk in range(disks):
            random = np.random.default_rng((crash_at, disk))
            raw = model.ModelFiles()
            life = Life(wrap(raw))
            die(model, life, raw, crash_at)
            raw.lose_power(random)
            if disk % 2:
                die(model, life, raw, int(random.integers(0, 12)))
                raw.lose_power(random)
            raw.arm(None)
            life.run("c")
            looked_at += 1
    return looked_at


def die(model: Any, life: Life, raw: Any, crash_at: int) -> None:
    raw.arm(crash_at)
    try:
        life.run(SCRIPT)
    except model.PowerLoss:
        return
    finally:
        raw.arm(None)


@pytest.fixture(autouse=True)
def small_manifest(monkeypatch: pytest.MonkeyPatch) -> None:
    """A manifest that is full after a few records."""
    monkeypatch.setattr(journal_module, "_capacity", lambda foundation: 6 * 4096)


def test_no_acknowledged_step_is_lost(kit: Any) -> None:
    assert campaign(kit.files) > 500


def test_a_failed_sync_followed_by_a_power_loss(kit: Any) -> None:
    """Read back from the page cache after a failed sync, then power is lost: nothing acknowledged later may vanish."""
    counted = kit.files.FailingFiles(kit.files.ModelFiles())
    Life(counted).run(SCRIPT)
    for fail_at in range(1, counted.count + 1):
        assert survive_failed_operation(kit.files, fail_at)


def survive_failed_operation(model: Any, fail_at: int) -> bool:
    raw = model.ModelFiles()
    failing = model.FailingFiles(raw)
    failing.fail_at = fail_at
    life = Life(failing)
    with pytest.raises((JournalError, OSError)):
        life.run(SCRIPT)
    raw.handles.clear()
    life.files = raw
    life.run("")  # another process reads what the page cache shows, and acknowledges it
    raw.handles.clear()
    raw.lose_power(np.random.default_rng(fail_at))
    life.run("cc")
    return True


# --- tests of the test: each seeded bug must be found ----------------------------------------------------------------


class Unsynced:
    """Forgets to sync the files, or folders, of some names."""

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
    """Keeps both slots in one file."""

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


FOUND = (AssertionError, JournalError, OSError)


@pytest.mark.parametrize("names", [("slot-0", "slot-1"), ("manifest",), ("manifest.new",), ("folder",)])
def test_a_missing_sync_is_found(kit: Any, names: tuple[str, ...]) -> None:
    with pytest.raises(FOUND):
        campaign(kit.files, lambda files: Unsynced(files, *names))


def test_a_single_slot_is_found(kit: Any) -> None:
    with pytest.raises(FOUND):
        campaign(kit.files, OneSlot)


def test_a_missing_slot_checksum_is_found(kit: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    honest = journal_files.view_slot

    def believe(path: Any, files: Any, foundation: Any) -> Any:
        view = honest(path, files, foundation)
        return journal_files.SlotView(view.record, view.blank, lambda: True)

    monkeypatch.setattr(journal_files, "view_slot", believe)
    monkeypatch.setattr(
        journal_module,
        "verified_state",
        lambda raw, ledger: np.frombuffer(raw, "<f8").reshape(NODES, DIMENSION),
    )
    with pytest.raises(FOUND):
        campaign(kit.files)


def test_a_record_written_before_its_slot_is_found(kit: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def hasty(self: Journal, entry: Commit, state: Any) -> None:
        packed = self._next_record(entry.as_body())
        if self._end + len(packed) > self.ledger.capacity:
            self._start_next_manifest()
            packed = self._next_record(entry.as_body())
        self._append(packed)
        self._write_slot(entry.step, packed, state)

    monkeypatch.setattr(Journal, "commit", hasty)
    with pytest.raises(FOUND):
        campaign(kit.files)


def test_trusting_the_page_cache_after_a_failed_sync_is_found(kit: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def trusting(self: Journal, found: Any) -> None:
        for record in found.completion:
            packed = journal_module.pack_record(record.sequence, record.previous, record.body)
            self._files.write(self._handles[0], self._end, packed)
            self._files.sync(self._handles[0])
            self._end += len(packed)

    monkeypatch.setattr(Journal, "_settle", trusting)
    counted = kit.files.FailingFiles(kit.files.ModelFiles())
    Life(counted).run(SCRIPT)

    def all_failures() -> None:
        for fail_at in range(1, counted.count + 1):
            survive_failed_operation(kit.files, fail_at)

    with pytest.raises(FOUND):
        all_failures()
