"""What Linux tells of processes: their children, open files and memory."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Usage", "descendants", "resident_bytes", "usage_of"]


@dataclass(frozen=True)
class Usage:
    """What a process holds."""

    files: int
    resident_bytes: int


def descendants(pid: int) -> set[int]:
    """A process, its children, and theirs."""
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()
    except OSError:
        return set()
    return {pid}.union(*(descendants(int(child)) for child in children))


def usage_of(pid: int) -> Usage:
    """Of a process that lives."""
    return Usage(len(os.listdir(f"/proc/{pid}/fd")), resident_bytes(pid))


def resident_bytes(pid: int | None = None) -> int:
    """Memory of a process, by default of this one."""
    words = Path(f"/proc/{pid or 'self'}/statm").read_text(encoding="ascii").split()
    return int(words[1]) * os.sysconf("SC_PAGE_SIZE")
