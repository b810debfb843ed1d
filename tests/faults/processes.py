"""What the system shows of processes: their children, open files and memory."""

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
    """Whether it runs: one that has ended, and whose parent has not waited for it yet, does not."""
    try:
        return bool(psutil.Process(pid).status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False


def children_of(pid: int) -> list[int]:
    """The processes that it has started and that have not ended, oldest first.

    Raises psutil.NoSuchProcess if it has ended.
    """
    children = sorted(psutil.Process(pid).children(), key=psutil.Process.create_time)
    return [child.pid for child in children]


def descendants(pid: int) -> set[int]:
    """A process, its children, and theirs; empty once it has ended."""
    try:
        return {pid, *(child.pid for child in psutil.Process(pid).children(recursive=True))}
    except psutil.NoSuchProcess:
        return set()


def usage_of(pid: int) -> Usage:
    process = psutil.Process(pid)
    return Usage(process.num_fds(), process.memory_info().rss)


def name_of(pid: int) -> str:
    """What ``ps -e`` calls it; empty once it has ended."""
    try:
        return str(psutil.Process(pid).name())
    except psutil.NoSuchProcess:
        return ""


def end_with_parent() -> None:
    """Let this process, which multiprocessing has started, end with the one that did so, however that ends."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
