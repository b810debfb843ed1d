"""The state folder: one server, one user."""

import errno
import fcntl
import json
import os
import stat
from pathlib import Path

import pytest
from mesh_motion_protocol.errors import ResourceExhausted

from mesh_motion_server.transport.endpoints import EndpointError
from mesh_motion_server.transport.state_folder import StateFolder


def test_a_second_server_is_refused_and_the_first_is_named(tmp_path: Path) -> None:
    first = StateFolder(tmp_path / "state")
    first.name_holder("tcp://127.0.0.1:7440")
    with pytest.raises(ResourceExhausted, match=f"process {os.getpid()} on .*, endpoint tcp://127.0.0.1:7440"):
        StateFolder(tmp_path / "state")
    first.release()
    StateFolder(tmp_path / "state").release()


@pytest.mark.parametrize("left", [b"", b"nonsense", b"[]", json.dumps({"pid": 1}).encode()])
def test_the_lock_file_of_a_crashed_server_is_not_a_lock(tmp_path: Path, left: bytes) -> None:
    (tmp_path / "server.lock").write_bytes(left)
    held = StateFolder(tmp_path)
    with pytest.raises(ResourceExhausted, match="held by another server: its process is just starting"):
        StateFolder(tmp_path)
    held.release()


def test_the_folder_stays_held_if_its_file_is_removed(tmp_path: Path) -> None:
    first = StateFolder(tmp_path)
    first.name_holder("tcp://127.0.0.1:7440")
    (tmp_path / "server.lock").unlink()
    with pytest.raises(ResourceExhausted, match=r"held by another server: its file .*server\.lock was removed"):
        StateFolder(tmp_path)
    assert not (tmp_path / "server.lock").exists()
    first.release()
    StateFolder(tmp_path).release()


def test_where_folders_cannot_be_locked_the_file_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on NFS, where the lock of a folder fails because a folder cannot be opened for writing."""

    def flock(descriptor: int, how: int) -> None:
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        real(descriptor, how)

    real = fcntl.flock
    monkeypatch.setattr(fcntl, "flock", flock)
    first = StateFolder(tmp_path)
    with pytest.raises(ResourceExhausted, match="held by another server"):
        StateFolder(tmp_path)
    first.release()


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702])
@pytest.mark.parametrize("name", [".", "sessions"])
def test_a_folder_that_others_may_write_to_is_refused(tmp_path: Path, name: str, mode: int) -> None:
    (tmp_path / "state" / "sessions").mkdir(parents=True)
    (tmp_path / "state" / name).chmod(mode)
    with pytest.raises(EndpointError, match=f"got {mode:04o}"):
        StateFolder(tmp_path / "state")


@pytest.mark.parametrize("by_link", [False, True])
@pytest.mark.parametrize(("mode", "accepted"), [(0o777, False), (0o703, False), (0o1777, True), (0o775, True)])
def test_a_folder_in_whose_place_all_users_may_put_another_is_refused(
    tmp_path: Path, mode: int, accepted: bool, by_link: bool
) -> None:
    above = tmp_path / "above"
    (above / "mine" / "state").mkdir(parents=True)
    (tmp_path / "link").symlink_to("above/mine/state")
    above.chmod(mode)
    state = tmp_path / "link" if by_link else above / "mine" / "state"
    if accepted:
        StateFolder(state).release()
    else:
        with pytest.raises(EndpointError, match=f"{above} has mode {mode:04o}"):
            StateFolder(state)


@pytest.mark.parametrize("what", ["file", "dangling", "loop"])
def test_a_path_that_is_not_a_folder_is_refused(tmp_path: Path, what: str) -> None:
    path = tmp_path / "state"
    path.touch() if what == "file" else path.symlink_to("nowhere" if what == "dangling" else path)
    with pytest.raises(ResourceExhausted, match="cannot be used: it is a file, or a link without a target"):
        StateFolder(path)


@pytest.mark.parametrize("what", ["folder", "pipe", "loop"])
def test_a_lock_that_is_no_file_is_named(tmp_path: Path, what: str) -> None:
    state = tmp_path / "state"
    StateFolder(state).release()
    lock = state / "server.lock"
    lock.unlink()
    if what == "loop":
        lock.symlink_to(lock)
    else:
        lock.mkdir() if what == "folder" else os.mkfifo(lock)
    with pytest.raises(ResourceExhausted, match=r"cannot be used: its file server\.lock: "):
        StateFolder(state).name_holder("ipc:///here")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_the_folder_or_link_of_a_stranger_is_refused(tmp_path: Path) -> None:
    (tmp_path / "state").mkdir(mode=0o700)
    (tmp_path / "link").symlink_to("state")
    StateFolder(tmp_path / "link").release()
    os.chown(tmp_path / "link", 65534, 65534, follow_symlinks=False)
    with pytest.raises(EndpointError, match="got user 65534"):
        StateFolder(tmp_path / "link")
    os.chown(tmp_path / "state", 65534, 65534)
    with pytest.raises(EndpointError, match="got user 65534"):
        StateFolder(tmp_path / "state")


def test_a_second_server_on_the_folder_of_a_live_one_ends_and_names_it(start, tmp_path) -> None:
    first = start()
    second = start(folder=tmp_path / "second", ready=False, state_folder=first.settings["state_folder"])
    assert second.process.wait(60) == 69
    assert f"process {first.process.pid} on" in second.log_path.read_text()
    assert first.endpoint in second.log_path.read_text()
