"""Room on disk and in memory, with the limits of a container."""

import errno
import os
from pathlib import Path

import pytest
from raising import raising

from mesh_motion_server.operation.room import DiskRoom, available_memory, disk_room, resident_bytes


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    write(tmp_path / "proc" / "meminfo", "MemTotal:  1000 kB\nMemAvailable:    800 kB\n")
    return tmp_path


def test_a_machine_without_control_groups(machine: Path) -> None:
    assert available_memory(machine / "proc", machine / "none") == 800 * 1024


def test_version_2_takes_the_least_of_all_groups_above(machine: Path) -> None:
    write(machine / "proc" / "self" / "cgroup", "0::/system.slice/mesh.service\n")
    slice_, service = machine / "cg" / "system.slice", machine / "cg" / "system.slice" / "mesh.service"
    write(service / "memory.max", "max\n")
    write(service / "memory.current", "1\n")
    assert available_memory(machine / "proc", machine / "cg") == 800 * 1024
    write(slice_ / "memory.max", "500000\n")
    write(slice_ / "memory.current", "450000\n")
    write(slice_ / "memory.stat", "anon 100\ninactive_file 30000\n")
    assert available_memory(machine / "proc", machine / "cg") == 80_000


def test_in_a_container_the_group_on_top_is_its_own(machine: Path) -> None:
    write(machine / "proc" / "self" / "cgroup", "0::/\n")
    write(machine / "cg" / "memory.max", "300000\n")
    write(machine / "cg" / "memory.current", "400000\n")
    assert available_memory(machine / "proc", machine / "cg") == 0


def test_version_1(machine: Path) -> None:
    write(machine / "proc" / "self" / "cgroup", "5:cpu,cpuacct:/a\n4:memory:/docker/abc\n")
    write(machine / "cg" / "memory" / "memory.limit_in_bytes", "200000\n")  # mounted inside the container
    write(machine / "cg" / "memory" / "memory.usage_in_bytes", "150000\n")
    write(machine / "cg" / "memory" / "memory.stat", "total_inactive_file 1000\n")
    assert available_memory(machine / "proc", machine / "cg") == 51_000


def test_a_system_that_does_not_say(tmp_path: Path) -> None:
    assert available_memory(tmp_path, tmp_path) is None
    assert resident_bytes(1, tmp_path) == 0


def test_this_machine() -> None:
    available = available_memory()
    assert available is not None
    assert available > 0
    assert resident_bytes(os.getpid()) > 1_000_000


def test_pages_are_counted_in_bytes(tmp_path: Path) -> None:
    write(tmp_path / "7" / "statm", "900 50 20 4 0 600 0\n")
    assert resident_bytes(7, tmp_path) == 50 * os.sysconf("SC_PAGE_SIZE")


def test_a_folder_that_is_not_there_yet(tmp_path: Path) -> None:
    there, later = disk_room(tmp_path), disk_room(tmp_path / "a" / "b")
    assert there.writable
    assert there.size == later.size > there.free > 0
    assert disk_room(Path("/proc/sys")).size == 0


def test_a_disk_that_does_not_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "statvfs", raising(OSError(5, "Input/output error")))
    assert disk_room(tmp_path) == DiskRoom(0, 0, False)


@pytest.mark.parametrize("failing", ["stat", "statvfs"])
def test_a_disk_that_does_not_answer_has_no_room(failing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, failing, raising(OSError(errno.EIO, "Input/output error")))
    found = disk_room(tmp_path)
    monkeypatch.undo()
    assert found == DiskRoom(0, 0, False)


def test_a_control_group_may_have_any_name(machine: Path) -> None:
    path = machine / "proc" / "self" / "cgroup"
    path.parent.mkdir(parents=True)
    path.write_bytes("0::/gitter-ü\n".encode() + b"1:cpu:/\xff\n")
    write(machine / "cg" / "gitter-ü" / "memory.max", "500000\n")
    write(machine / "cg" / "gitter-ü" / "memory.current", "450000\n")
    assert available_memory(machine / "proc", machine / "cg") == 50_000
