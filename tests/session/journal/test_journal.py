"""The journal: exact continuation, a full manifest, truncation at every length, damage."""

import errno
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_motion_protocol.digests import state_digest
from mesh_motion_protocol.errors import DataLoss
from raising import raising

from mesh_motion_server.session.journal import journal as journal_module
from mesh_motion_server.session.journal.files import KEPT_COMMITS, read_journal, read_ledger
from mesh_motion_server.session.journal.filesystem import PosixFileSystem
from mesh_motion_server.session.journal.journal import Journal, record_area
from mesh_motion_server.session.journal.ledger import Commit, Foundation
from mesh_motion_server.session.journal.records import PAGE
from mesh_motion_server.session.journal.replies import RequestId
from tests.faults.journal_damage import read_back
from tests.faults.model_files import ModelFiles

NODES = 40
FOUNDATION = Foundation("0" * 32, b"s" * 32, b"m" * 32, NODES, 2, 4096)


def state_of(step: int) -> Any:
    return np.random.default_rng(step).random((NODES, 2))


def entry_of(step: int) -> Commit:
    request = RequestId(b"c" * 16, step, bytes([step % 256]) * 32)
    return Commit(step, state_digest(step, state_of(step)), (request,), b"receipt")


def write(folder: Path, steps: int) -> Journal:
    journal = Journal.create(folder, PosixFileSystem(), FOUNDATION)
    for step in range(1, steps + 1):
        journal.store(entry_of(step), state_of(step))
    return journal


def reopen(folder: Path, files: PosixFileSystem | None = None) -> Journal:
    return Journal.open(folder, files or PosixFileSystem())


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal_module, "manifest_capacity", lambda foundation: 8 * PAGE)


@pytest.fixture(params=["small states", "large states"])
def any_size(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param == "large states":
        monkeypatch.setattr(journal_module, "_LARGE_STATE", 0)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_states_written_ahead_make_the_same_files(tmp_path: Path, any_size: None) -> None:
    (tmp_path / "once").mkdir()
    (tmp_path / "ahead").mkdir()
    write(tmp_path / "once", 3).close()
    journal = write(tmp_path / "ahead", 0)
    for step in (1, 2, 3):
        state = state_of(step)
        journal.write_ahead(state_of(7))  # a trial that is given up
        journal.write_ahead(state)
        journal.store(entry_of(step), state)
    journal.close()
    assert contents(tmp_path / "once") == contents(tmp_path / "ahead")


def test_another_state_than_the_one_written_ahead_is_stored(tmp_path: Path, any_size: None) -> None:
    journal = write(tmp_path, 1)
    journal.write_ahead(state_of(7))
    journal.store(entry_of(2), state_of(2))
    journal.close()
    np.testing.assert_array_equal(reopen(tmp_path).read_state(), state_of(2))


def test_a_state_written_ahead_and_not_stored_changes_nothing(tmp_path: Path, any_size: None) -> None:
    journal = write(tmp_path, 3)
    journal.write_ahead(state_of(4))
    journal.close()
    again = reopen(tmp_path)
    assert again.ledger.step == 3
    np.testing.assert_array_equal(again.read_state(), state_of(3))


@pytest.mark.parametrize("spare", [0, 1])
def test_a_state_is_written_once_and_a_large_one_is_synced_ahead(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spare: int
) -> None:
    journal, state, done = write(tmp_path, 0), state_of(1), []
    monkeypatch.setattr(journal_module, "_LARGE_STATE", state.nbytes + spare)
    for name, honest in [(name, getattr(PosixFileSystem, name)) for name in ("write", "sync")]:

        def watched(self: Any, handle: int, *rest: Any, name: str = name, honest: Any = honest) -> Any:
            done.append((name, ("manifest", "slot-0", "slot-1")[journal._handles.index(handle)]))
            return honest(self, handle, *rest)

        monkeypatch.setattr(PosixFileSystem, name, watched)
    journal.write_ahead(state)
    journal._ahead[1].wait()
    assert done == [("write", "slot-1"), ("sync", "slot-1")][: 2 - spare]
    done.clear()
    journal.store(entry_of(1), state)
    assert done == [("write", "slot-1"), ("sync", "slot-1"), ("write", "manifest"), ("sync", "manifest")]
    journal.close()


def test_closing_waits_for_what_is_written_ahead(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal_module, "_LARGE_STATE", 0)
    journal, go_on, written, honest = write(tmp_path, 0), threading.Event(), [], PosixFileSystem.write

    def held(self: Any, *given: Any) -> int:
        assert go_on.wait(30)
        written.append(honest(self, *given))
        return written[-1]

    monkeypatch.setattr(PosixFileSystem, "write", held)
    journal.write_ahead(state_of(1))
    threading.Timer(0.1, go_on.set).start()
    journal.close()
    assert written == [FOUNDATION.state_bytes]


class Broken(PosixFileSystem):
    """Takes records, but no state."""

    def write(self, handle: int, offset: int, data: Any) -> int:
        if len(data) == FOUNDATION.state_bytes:
            raise OSError(errno.EIO, "broken")
        return super().write(handle, offset, data)


@pytest.mark.parametrize("following", ["store", "write_ahead"])
def test_a_disk_that_fails_ahead_freezes(tmp_path: Path, any_size: None, following: str) -> None:
    write(tmp_path, 0).close()
    journal, state = reopen(tmp_path, Broken()), state_of(1)
    journal.write_ahead(state)
    with pytest.raises(DataLoss, match="committing step 1: broken") as caught:
        journal.store(entry_of(1), state) if following == "store" else journal.write_ahead(state)
    assert caught.value.code == "RESOURCE_EXHAUSTED.DISK"
    assert journal.frozen
    journal.close()
    assert reopen(tmp_path).ledger.step == 0


@pytest.mark.usefixtures("small")
def test_a_full_manifest_is_replaced_and_stays_bounded(tmp_path: Path) -> None:
    journal = write(tmp_path, 30)
    assert (tmp_path / "manifest").stat().st_size == 8 * PAGE
    assert len(journal.ledger.commits) == KEPT_COMMITS
    for _ in range(10):
        journal.raise_epoch()
    journal.close()
    again = reopen(tmp_path)
    assert (again.ledger.step, again.ledger.epoch) == (30, 11)
    assert again.ledger.commits == tuple(entry_of(step) for step in range(31 - KEPT_COMMITS, 31))
    np.testing.assert_array_equal(again.read_state(), state_of(30))
    again.close()


def test_a_step_out_of_turn_is_refused(tmp_path: Path) -> None:
    journal = write(tmp_path, 1)
    with pytest.raises(DataLoss, match="does not follow step 1"):
        journal.store(entry_of(3), state_of(3))
    assert journal.frozen
    journal.close()


def test_a_state_of_the_wrong_size_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    journal = write(tmp_path, 1)
    short = state_of(2)[1:]
    for refuse in (lambda: journal.store(entry_of(2), short), lambda: journal.write_ahead(short)):
        with pytest.raises(DataLoss, match="the state of step 2 does not fit"):
            refuse()
    assert not journal.frozen
    journal.store(entry_of(2), state_of(2))
    journal.close()


def test_the_record_area_holds_a_receipt_and_every_partition() -> None:
    for partitions in (1, 7, 256):
        requests = tuple(RequestId(bytes(16), 2**62, bytes(32)) for _ in range(partitions))
        commit = Commit(2**40, bytes(32), requests, bytes(8000))
        packed = journal_module.pack_record(2**40, bytes(32), commit.as_body())
        assert len(packed) <= record_area(partitions)
        assert record_area(partitions) % PAGE == 0


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("fill", ["cut", "zeros"])
def test_the_tail_torn_at_every_length(tmp_path: Path, fill: str) -> None:
    """With up to two lost records, their slots complete them. With three lost records, the slots show that something is
    missing.
    """
    write(tmp_path, 3).close()
    whole = {path: path.read_bytes() for path in tmp_path.iterdir()}
    manifest = whole[tmp_path / "manifest"]
    used = len(manifest.rstrip(b"\0"))
    outcomes = {}
    for length in range(0, used + 1, 7):
        padding = bytes(len(manifest) - length) if fill == "zeros" else b""
        damaged = whole | {tmp_path / "manifest": manifest[:length] + padding}
        outcomes[length] = read_back(damaged, (entry_of, state_of))
    complete = record_bytes(manifest, 1)
    assert {step for length, step in outcomes.items() if length >= complete} == {3}
    assert {step for length, step in outcomes.items() if length < complete} == {-1}


def record_bytes(manifest: bytes, number: int) -> int:
    """End of a record's bytes without its padding."""
    return len(manifest[: (number + 1) * PAGE].rstrip(b"\0"))


def test_a_damaged_state_names_its_step(tmp_path: Path) -> None:
    write(tmp_path, 2).close()
    with (tmp_path / "slot-0").open("r+b") as file:
        file.seek(FOUNDATION.record_area + 5)
        file.write(b"\xff")
    with pytest.raises(DataLoss, match="committed step 2") as error:
        reopen(tmp_path)
    assert error.value.code == "DATA_LOSS.CHECKSUM"
    assert error.value.details == {"step": 2}


def test_a_torn_epoch_is_skipped_not_reused(tmp_path: Path) -> None:
    journal = write(tmp_path, 1)
    assert journal.raise_epoch() == 2
    journal.close()
    with (tmp_path / "manifest").open("r+b") as file:
        file.seek(2 * PAGE + 60)
        file.write(b"\xff\xff")
    again = reopen(tmp_path)
    assert again.raise_epoch() == 3
    again.close()


def test_lists_read_the_manifest_alone(tmp_path: Path) -> None:
    write(tmp_path, 3).close()
    (tmp_path / "slot-0").unlink()
    assert read_ledger(tmp_path, PosixFileSystem()).step == 3


class Crowded(PosixFileSystem):
    """A disk that other programs fill at the moment of a manifest's replacement."""

    replaced = False

    def rename(self, source: Path, target: Path) -> None:
        super().rename(source, target)
        self.replaced = True

    def create(self, path: Path, size: int) -> int:
        if self.replaced and path.name == "manifest.new":
            self.close(super().create(path, 0))
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().create(path, size)


def test_a_manifest_without_room_for_the_next_one_is_filled(tmp_path: Path, small: None) -> None:
    write(tmp_path, 0).close()
    files = Crowded()
    journal = Journal.open(tmp_path, files)
    steps = 0
    while not files.replaced:
        steps += 1
        journal.store(entry_of(steps), state_of(steps))
    journal.store(entry_of(steps + 1), state_of(steps + 1))
    assert not journal.frozen
    assert not (tmp_path / "manifest.new").exists()
    journal.close()
    again = reopen(tmp_path)
    assert again.ledger.step == steps + 1
    again.close()


@pytest.mark.parametrize(
    ("area", "log_bytes", "capacity"), [(20_480, 0, 1 << 20), (81_920, 0, 24 * 81_920), (20_480, 1 << 20, 3 << 20)]
)
def test_a_manifest_has_room_for_a_checkpoint_and_as_much_again(area: int, log_bytes: int, capacity: int) -> None:
    foundation = Foundation("0" * 32, b"s", b"m", 4, 2, area, log_bytes=log_bytes)
    files = ModelFiles()
    Journal.create(Path("/session"), files, foundation).close()
    for name in ("manifest", "manifest.new"):
        assert len(files.entries[Path("/session") / name].cache) == capacity


@pytest.mark.usefixtures("small")
def test_a_manifest_is_filled_to_its_last_page_before_it_is_replaced(tmp_path: Path) -> None:
    journal = write(tmp_path, 7)
    assert [record.kind for record in read_journal(tmp_path, PosixFileSystem()).records] == ["build"] + 7 * ["commit"]
    journal.store(entry_of(8), state_of(8))
    assert [record.kind for record in read_journal(tmp_path, PosixFileSystem()).records] == ["checkpoint", "commit"]
    assert (tmp_path / "manifest.new").stat().st_size == 8 * PAGE
    journal.close()


@pytest.mark.parametrize(
    ("capacity", "receipt", "says"),
    [(PAGE, 1, "does not fit the manifest"), (8 * PAGE, PAGE, "takes 8192 bytes of 4096")],
)
def test_a_record_that_does_not_fit_is_refused(tmp_path: Path, capacity: int, receipt: int, says: str) -> None:
    journal = Journal.create(tmp_path, PosixFileSystem(), FOUNDATION, capacity=capacity)
    commit = Commit(1, state_digest(1, state_of(1)), (), bytes(receipt))
    with pytest.raises(DataLoss, match=says) as caught:
        journal.store(commit, state_of(1))
    assert (caught.value.code, journal.frozen, journal.ledger.step) == ("INTERNAL", True, 0)
    assert (tmp_path / "manifest").stat().st_size == capacity
    journal.close()


def test_an_error_of_the_disk_without_a_number_is_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    journal = write(tmp_path, 0)
    with monkeypatch.context() as patch:
        patch.setattr(PosixFileSystem, "sync", raising(OSError("the disk is gone")))
        with pytest.raises(DataLoss, match=r"the disk is gone \(unknown\)") as caught:
            journal.raise_epoch()
    assert caught.value.details == {"errno": "unknown"}
    journal.close()
