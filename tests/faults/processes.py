"""Data of the system about processes: their children, open files and memory."""

import os
import threading
from dataclasses import dataclass
from multiprocessing import parent_process
from multiprocessing.connection import wait

import psutil  # type: ignore[import-untyped]


@dataclass(frozen=True)
class Usage:
    files: int
    resident_bytes: int


def alive(pid: int) -> bool:
    """Whether the process runs: an ended process whose parent has not waited for it does not."""
    try:
        return bool(psutil.Process(pid).status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False


def children_of(pid: int) -> list[int]:
    """Living children of the process, oldest first.

    Raises psutil.NoSuchProcess if it has ended.
    """
    children = sorted(psutil.Process(pid).children(), key=psutil.Process.create_time)
    return [child.pid for child in children]


def descendants(pid: int) -> set[int]:
    """A process with all its descendants; empty after its end."""
    try:
        return {pid, *(child.pid for child in psutil.Process(pid).children(recursive=True))}
    except psutil.NoSuchProcess:
        return set()


def usage_of(pid: int) -> Usage:
    process = psutil.Process(pid)
    return Usage(process.num_fds(), process.memory_info().rss)


def name_of(pid: int) -> str:
    """Name of the process in ``ps -e``; empty after its end."""
    try:
        return str(psutil.Process(pid).name())
    except psutil.NoSuchProcess:
        return ""


def end_with_parent() -> None:
    """Let this process, started by multiprocessing, end with its parent, in whatever way the parent ends."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
