"""The space of the next manifest is held from BUILD on, even if other programs fill the disk."""

import errno
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mesh_motion_protocol.messages import Commit, Move

from mesh_motion_server.session.journal import next_manifest
from mesh_motion_server.session.store import SessionStore
from tests.faults.driver import SESSION, make_driver, resume_driver
from tests.faults.model_files import ModelFiles
from tests.faults.stand_in import grid_mesh

FOLDER = Path("/state/sessions") / SESSION
RESERVE = FOLDER / "manifest.new"


class FullDisk(ModelFiles):
    """Other programs take all free bytes of the disk at once; writes in place need none."""

    full = False

    def create(self, path: Path, size: int) -> int:
        handle = super().create(path, 0 if self.full else size)
        if self.full and size:
            self.close(handle)
            raise OSError(errno.ENOSPC, "No space left on device")
        return handle


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A session with a manifest of few commits, and its disk."""
    monkeypatch.setattr(next_manifest, "_LEAST_CAPACITY", 1 << 17)
    monkeypatch.setattr(next_manifest, "_LEAST_RECORDS", 2)
    files = FullDisk()
    driver = make_driver(SessionStore("/state", files=files), [grid_mesh()])
    driver.open()
    yield driver, files
    driver.host.close()


def commit_until(driver: Any, files: FullDisk, renames: int) -> None:
    """Commit until this number of manifests has been replaced."""
    seen = sum(operation == "rename manifest" for operation in files.operations)
    while sum(operation == "rename manifest" for operation in files.operations) < seen + renames:
        step = driver.host.step + 1
        driver.all(Move, driver.displacement(step % 2), step=step)
        (reply,) = driver.all(Commit, step=step)
        assert reply.type == "COMMITTED", reply


def test_a_full_disk_takes_nothing_of_what_was_held(built: Any) -> None:
    driver, files = built
    files.full = True
    commit_until(driver, files, 1)
    assert driver.host.state == "READY"
    assert not files.exists(RESERVE)  # there was no room for the one after it
    files.full = False
    driver.host.close()
    again = resume_driver(driver, SessionStore("/state", files=files))
    assert files.size(files.open(RESERVE)) == files.size(files.open(FOLDER / "manifest"))
    again.host.close()


def test_resuming_on_a_full_disk_keeps_what_was_held(built: Any) -> None:
    driver, files = built
    driver.host.close()
    files.full = True
    again = resume_driver(driver, SessionStore("/state", files=files))
    commit_until(again, files, 1)
    assert again.host.state == "READY"
    again.host.close()


def test_content_that_a_crash_left_in_it_is_not_used(built: Any) -> None:
    driver, files = built
    driver.host.close()
    for place in (0, 5000, len(files.entries[RESERVE].cache) - 1):
        files.entries[RESERVE].cache[place] = 1
        driver = resume_driver(driver, SessionStore("/state", files=files))
        assert not any(files.entries[RESERVE].cache)
        driver.host.close()


def test_a_manifest_that_a_crash_has_left_under_both_names_is_not_overwritten(built: Any) -> None:
    driver, files = built
    commit_until(driver, files, 1)
    step = driver.host.step
    driver.host.close()
    files.entries[RESERVE] = files.entries[FOLDER / "manifest"]
    for _ in range(2):
        driver = resume_driver(driver, SessionStore("/state", files=files))
        assert files.entries[RESERVE] is not files.entries[FOLDER / "manifest"]
        assert driver.host.step == step
        driver.host.close()


def test_so_it_is_on_a_disk(tmp_path: Path) -> None:
    """A file system on which emptying the file under one name would empty it under the other."""
    store = SessionStore(tmp_path)
    driver = make_driver(store, [grid_mesh()])
    driver.open()
    driver.advance(1)
    driver.host.close()
    folder = tmp_path / "sessions" / SESSION
    (folder / "manifest.new").unlink()
    (folder / "manifest.new").hardlink_to(folder / "manifest")
    again = resume_driver(driver, store)
    assert again.host.step == 1
    again.host.close()
    assert (folder / "manifest").stat().st_nlink == 1


@pytest.mark.parametrize("size", [0, 1, (1 << 17) - 1, 1 << 18])
def test_a_next_manifest_of_the_wrong_size_is_made_again(built: Any, size: int) -> None:
    driver, files = built
    driver.host.close()
    whole = len(files.entries[RESERVE].cache)
    files.entries[RESERVE].cache[:] = b"x" * size
    again = resume_driver(driver, SessionStore("/state", files=files))
    assert bytes(files.entries[RESERVE].cache) == bytes(whole)
    again.host.close()


def test_a_part_at_a_time_is_looked_through(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(next_manifest, "_PART", 7)
    files = ModelFiles()
    next_manifest.reserve(FOLDER, files, 100)
    held = files.entries[RESERVE]
    next_manifest.reserve(FOLDER, files, 100)
    assert files.entries[RESERVE] is held
    for place in range(100):
        files.entries[RESERVE].cache[place] = 1
        next_manifest.reserve(FOLDER, files, 100)
        assert bytes(files.entries[RESERVE].cache) == bytes(100)
    assert files.handles == {}


@pytest.mark.parametrize("size", [None, 4096])
def test_without_what_was_held_the_next_manifest_is_made_of_new_space(built: Any, size: int | None) -> None:
    driver, files = built
    files.remove(RESERVE)
    if size is not None:
        files.close(files.create(RESERVE, size))
    opened = len(files.handles)
    commit_until(driver, files, 1)
    assert len(files.handles) == opened
    assert len(files.entries[RESERVE].cache) == len(files.entries[FOLDER / "manifest"].cache)
    driver.host.close()
    again = resume_driver(driver, SessionStore("/state", files=files))
    assert again.host.step == driver.host.step
    again.host.close()
