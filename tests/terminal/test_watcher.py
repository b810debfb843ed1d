"""The thread that looks outlives whatever a disk says."""

from __future__ import annotations

import queue

from mesh_motion_server.watch.terminal.sources import Details, SessionLine
from mesh_motion_server.watch.terminal.watcher import Look, Watcher

LINE = SessionLine("1" * 32, "wing", "READY", 3)


class _Failing:
    """A source whose list, then whose details cannot be read once."""

    where = "a folder"

    def __init__(self) -> None:
        self.lists: list[Exception | None] = [OSError(116, "Stale file handle"), None, None]
        self.histories: list[Exception | None] = [OSError(5, "Input/output error"), None]

    def sessions(self) -> list[SessionLine]:
        if self.lists and (error := self.lists.pop(0)):
            raise error
        return [LINE]

    def details(self, session: str, seconds: float) -> Details | None:
        if self.histories and (error := self.histories.pop(0)):
            raise error
        return None

    def verdict(self, lines: list[SessionLine]) -> str:
        return ""

    def close(self) -> None:
        pass


def test_an_error_of_the_disk_is_told_and_ends_nothing() -> None:
    looks: queue.Queue[Look] = queue.Queue()
    watcher = Watcher(_Failing(), looks.put, every=0.01)
    watcher.start()
    try:
        troubles: list[str] = []
        while not troubles or troubles[-1]:
            troubles.append(looks.get(timeout=60).trouble)
    finally:
        watcher.stop()
    assert "Stale file handle" in troubles[0]
    assert any("Input/output error" in said for said in troubles)
