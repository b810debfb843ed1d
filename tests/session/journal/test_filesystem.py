"""The operating system's files behave as the journal requires; so does the model of them."""

from pathlib import Path
from typing import Any

import pytest

from mesh_motion_server.session.journal.filesystem import FileSystem, PosixFileSystem, write_all
from tests.faults.model_files import ModelFiles, ShortFiles


@pytest.fixture(params=["posix", "model"])
def files(request: pytest.FixtureRequest) -> Any:
    return PosixFileSystem() if request.param == "posix" else ModelFiles()


@pytest.fixture
def folder(files: FileSystem, tmp_path: Path) -> Path:
    files.make_folder(tmp_path / "a")
    return tmp_path / "a"


def test_reads_give_the_written_bytes(files: FileSystem, folder: Path) -> None:
    handle = files.create(folder / "f", 10)
    assert (files.size(handle), files.read(handle, 0, 99)) == (10, bytes(10))
    assert write_all(files, handle, 8, b"abcd") == 12
    files.sync(handle)
    assert files.read(handle, 7, 100) == b"\0abcd"
    assert files.read(handle, 12, 1) == b""
    files.close(handle)
    again = files.open(folder / "f", writable=False)
    assert files.size(again) == 12
    files.close(again)
    files.close(files.create(folder / "f", 3))
    assert files.read(files.open(folder / "f"), 0, 9) == bytes(3)


def test_names(files: FileSystem, folder: Path) -> None:
    for name in ("f", "g"):
        handle = files.create(folder / name, 0)
        write_all(files, handle, 0, name.encode())
        files.close(handle)
    files.rename(folder / "f", folder / "g")
    files.sync_folder(folder)
    assert not files.exists(folder / "f")
    assert files.read(files.open(folder / "g"), 0, 9) == b"f"
    files.remove(folder / "g")
    files.remove(folder / "g")
    assert not files.exists(folder / "g")
    with pytest.raises(FileNotFoundError):
        files.open(folder / "g")


def test_a_lock_is_held_once(files: FileSystem, folder: Path) -> None:
    lock = files.lock(folder / "lock")
    with pytest.raises(BlockingIOError):
        files.lock(folder / "lock")
    files.close(lock)
    files.close(files.lock(folder / "lock"))


def test_a_write_that_takes_nothing_is_an_error(tmp_path: Path) -> None:
    stuck = ShortFiles(PosixFileSystem(), 0)
    handle = stuck.create(tmp_path / "f", 0)
    with pytest.raises(OSError, match="took no byte"):
        write_all(stuck, handle, 0, b"abc")
    stuck.close(handle)


def test_no_room_is_reported_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"No space|too large|Invalid"):
        PosixFileSystem().create(tmp_path / "f", 1 << 60)
