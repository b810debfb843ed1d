"""An error of the disk never looks like a missing file where the result decides what is written, removed or ended."""

import errno
import os
import re
from pathlib import Path

import pytest
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.absence import is_missing
from mesh_motion_server.operation.room import disk_room
from mesh_motion_server.security.key_folder import make_server_keys
from mesh_motion_server.session.history.segments import list_segments

ROOT = Path(__file__).parents[1] / "mesh_motion_server"


def test_only_what_is_not_there_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "link").symlink_to("nowhere")
    assert is_missing(tmp_path / "none")
    assert not is_missing(tmp_path / "link")
    assert disk_room(tmp_path / "none" / "below").size > 0
    fail(monkeypatch, tmp_path)
    with pytest.raises(OSError, match=os.strerror(errno.EIO)):
        is_missing(tmp_path / "none")
    assert disk_room(tmp_path / "none").size == 0


def fail(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Let the disk fail for all files of a folder."""
    real = os.lstat

    def lstat(path: Path, **rest: object) -> os.stat_result:
        if folder in Path(path).parents:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return real(path)

    monkeypatch.setattr(Path, "lstat", lstat)
    monkeypatch.setattr(os, "statvfs", lstat)


def test_an_allow_list_that_cannot_be_read_is_not_emptied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_server_keys(tmp_path)
    (written,) = set(tmp_path.iterdir()) - {tmp_path / "server.secret", tmp_path / "server.public"}
    written.write_text("[keys]\n# all of a year's keys\n")
    for pair in tmp_path.glob("server.*"):
        pair.unlink()
    fail(monkeypatch, tmp_path)
    with pytest.raises(InvalidInput, match=f"{written}: cannot be read: Input/output error"):
        make_server_keys(tmp_path)
    assert "a year's keys" in written.read_text()


def test_segments_that_cannot_be_listed_are_not_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert list_segments(tmp_path / "none", "events") == []

    def failing(_: Path) -> None:
        raise OSError(errno.ESTALE, os.strerror(errno.ESTALE))

    monkeypatch.setattr(os, "scandir", failing)
    with pytest.raises(OSError, match=os.strerror(errno.ESTALE)):
        list_segments(tmp_path, "events")


@pytest.mark.parametrize("package", ["session", "security", "operation", "transport", "service"])
def test_nothing_there_asks_pathlib(package: str) -> None:
    """``Path.exists()`` and similar functions hide errors; ``is_symlink`` and ``is_socket`` return True only if it is
    so.
    """
    asks = re.compile(r"\.(exists|is_file|is_dir|lexists)\(")
    for path in (ROOT / package).rglob("*.py"):
        found = [line for line in path.read_text().splitlines() if asks.search(line)]
        assert not [line for line in found if "files.exists(" not in line and "# a key or a file" not in line], path
