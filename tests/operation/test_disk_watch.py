"""A disk that does not answer: the waiting requests, and their time limit."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from mesh_motion_protocol.errors import ResourceExhausted
from raising import raising

from mesh_motion_server.operation import disk_watch
from mesh_motion_server.operation.disk_watch import DiskWatch
from mesh_motion_server.operation.readiness import Readiness
from mesh_motion_server.operation.room import DiskRoom, disk_room


class Disk:
    def __init__(self) -> None:
        self.well = threading.Event()
        self.well.set()
        self.free = 10
        self.asked = 0

    def look(self, _folder: Path) -> DiskRoom:
        """A replacement of the system call."""
        self.asked += 1
        self.well.wait(60)
        return DiskRoom(self.free, 100, True)


@pytest.fixture
def disk() -> Iterator[Disk]:
    disk = Disk()
    yield disk
    disk.well.set()


def test_this_disk(tmp_path: Path) -> None:
    found = DiskWatch(tmp_path).fresh()
    assert found.writable
    assert found.size == disk_room(tmp_path).size


def test_the_answer_is_that_of_the_moment(disk: Disk, tmp_path: Path) -> None:
    watch = DiskWatch(tmp_path, disk.look)
    assert watch.room.free == 0
    assert watch.fresh().free == 10
    disk.free = 5
    assert watch.room.free == 10
    assert watch.fresh().free == 5
    assert watch.silence() == 0.0


def test_a_disk_that_is_silent_is_asked_once_and_holds_up_no_request(
    disk: Disk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(disk_watch, "_FRESH_SECONDS", 0.2)
    monkeypatch.setattr(disk_watch, "SILENT_SECONDS", 0.3)
    watch = DiskWatch(tmp_path, disk.look)
    watch.fresh()
    disk.well.clear()
    began = time.monotonic()
    watch.ask()
    watch.require_answers()
    for _ in range(200):
        watch.ask()
        with pytest.raises(ResourceExhausted, match="does not answer") as caught:
            watch.fresh()
    assert caught.value.code == "RESOURCE_EXHAUSTED.DISK"
    assert time.monotonic() - began < 30  # they waited for the first question together: each of them is a minute
    assert disk.asked == 2
    while watch.silence() <= 0.3:
        time.sleep(0.01)
    with pytest.raises(ResourceExhausted, match="does not answer"):
        watch.require_answers()
    assert watch.room.free == 10
    disk.well.set()
    disk.free = 7
    while watch.silence():
        time.sleep(0.001)
    watch.require_answers()
    assert watch.fresh().free == 7


def test_without_memory_for_a_thread_the_last_answer_stays(
    disk: Disk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    watch = DiskWatch(tmp_path, disk.look)
    watch.fresh()
    monkeypatch.setattr(threading.Thread, "start", raising(RuntimeError("can't start new thread")))
    assert watch.fresh().free == 10
    assert watch.silence() == 0.0


def test_silence_is_reported_before_what_the_disk_said_last() -> None:
    well = Readiness(False, False, True, False, DiskRoom(10, 100, True), 0.0, 5)
    assert well.missing() == ""
    silent = Readiness(False, False, True, False, DiskRoom(0, 100, False), 12.3, 5)
    assert silent.missing() == "disk: it has not answered for 12 s"
