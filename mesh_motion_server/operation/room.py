"""Free room: on the disk with the state folder, and in the memory that this server may use.

In a container the machine's own figures are too large: the result is the minimum of them and of the limits of the
control groups above this process (version 2 or 1).
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mesh_motion_server.absence import is_missing

_PROC = Path("/proc")
_CGROUPS = Path("/sys/fs/cgroup")


@dataclass(frozen=True)
class DiskRoom:
    """The room of a file system."""

    #: free, size: bytes; ``free`` counts what this user may use
    free: int
    size: int
    writable: bool  # whether this user may write into the folder


def disk_room(folder: Path) -> DiskRoom:
    """Return the room in a folder, or in its nearest existing parent; nothing if the disk does not answer."""
    try:
        while is_missing(folder) and folder != folder.parent:
            folder = folder.parent
        found = os.statvfs(folder)
    except OSError:
        return DiskRoom(0, 0, False)
    writable = not found.f_flag & os.ST_RDONLY and os.access(folder, os.W_OK | os.X_OK)
    return DiskRoom(found.f_bavail * found.f_frsize, found.f_blocks * found.f_frsize, writable)


def available_memory(proc: Path = _PROC, cgroups: Path = _CGROUPS) -> int | None:
    """Return the bytes that this server may still use without swapping; None if the system does not report them."""
    found = [room for room in (_machine(proc), *_control_groups(proc, cgroups)) if room is not None]
    return max(0, min(found)) if found else None


def resident_bytes(pid: int, proc: Path = _PROC) -> int:
    """Return the resident memory of a process, 0 if it is gone."""
    fields = _read(proc / str(pid) / "statm").split()
    return int(fields[1]) * os.sysconf("SC_PAGE_SIZE") if len(fields) > 1 else 0


def _machine(proc: Path) -> int | None:
    for line in _read(proc / "meminfo").splitlines():
        if line.startswith("MemAvailable:"):
            return 1024 * int(line.split()[1])
    return None


def _control_groups(proc: Path, cgroups: Path) -> Iterator[int | None]:
    """Return the remaining bytes of each control group with a limit above this process."""
    for line in _read(proc / "self" / "cgroup").splitlines():
        _, controllers, path = line.split(":", 2)
        if not controllers:
            names = ("memory.max", "memory.current", "inactive_file")
            top = cgroups
        elif "memory" in controllers.split(","):
            names = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
            top = cgroups / "memory"
        else:
            continue
        # in a container the path is the host's path or "/": then the top folder is the container's own group
        group = top / path.strip("/")
        for folder in {top, *(above for above in (group, *group.parents) if above.is_relative_to(top))}:
            yield _left_in(folder, *names)


def _left_in(group: Path, limit_name: str, usage_name: str, reclaimable_name: str) -> int | None:
    """Return the limit minus the usage, without pages that can be dropped at once."""
    limit, usage = _read(group / limit_name).strip(), _read(group / usage_name).strip()
    if not (limit.isdigit() and usage.isdigit()):
        return None  # "max", or this level has no such group
    statistics = dict(line.split()[:2] for line in _read(group / "memory.stat").splitlines())
    return int(limit) - int(usage) + int(statistics.get(reclaimable_name, 0))


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="surrogateescape")  # a control group may have any name
    except OSError:
        return ""
