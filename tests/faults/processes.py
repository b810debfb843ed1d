"""What Linux shows of processes: their children, open files and memory."""

import os
from dataclasses import dataclass
from pathlib import Path

from mesh_motion_server.operation.room import resident_bytes


@dataclass(frozen=True)
class Usage:
    """What a process holds."""

    files: int
    resident_bytes: int


def alive(pid: int) -> bool:
    """Whether it runs: one that has ended, and whose parent has not waited for it yet, does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def children_of(pid: int) -> list[int]:
    """The processes that it has started and that have not ended, oldest first.

    Raises OSError if it has ended.
    """
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()]


def descendants(pid: int) -> set[int]:
    """A process, its children, and theirs; empty once it has ended."""
    try:
        children = children_of(pid)
    except OSError:
        return set()
    return {pid}.union(*(descendants(child) for child in children))


def usage_of(pid: int) -> Usage:
    """Of a process that lives."""
    return Usage(len(os.listdir(f"/proc/{pid}/fd")), resident_bytes(pid))


def proportional_bytes(pid: int) -> int:
    """Memory of a process, of what it shares with others its part; 0 once it has ended."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines()
    except OSError:
        return 0
    return sum(1024 * int(line.split()[1]) for line in lines if line.startswith("Pss:"))


def threads_of(pid: int) -> int:
    """How many threads a process has."""
    return len(os.listdir(f"/proc/{pid}/task"))


def name_of(pid: int) -> str:
    """What ``ps -e`` calls it; empty once it has ended."""
    try:
        return Path(f"/proc/{pid}/comm").read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
