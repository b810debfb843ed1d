"""The supervisor's loop with children that are scripted: what it survives."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgpack
import pytest

from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport import supervisor as supervisor_module
from mesh_motion_server.transport import watch as watch_module
from mesh_motion_server.transport.channel import Channel
from mesh_motion_server.transport.hosting import Hosting
from mesh_motion_server.transport.processes import Child
from mesh_motion_server.transport.supervisor import Supervisor


class Ended:
    """A process that is over."""

    pid = 2**22

    def kill(self) -> None:
        """See subprocess.Popen."""

    def wait(self, timeout: float | None = None) -> int:
        """See subprocess.Popen."""
        return 0


class Scripted:
    """A supervisor whose children are lines without a process; ``refused``: so many are refused by the system."""

    def __init__(self, folder: Path) -> None:
        settings = ServerSettings.from_mapping({"state_folder": str(folder), "metrics": "127.0.0.1:0"})
        self.supervisor = Supervisor(settings, Hosting(), "error")
        self.refused = 0
        self.children: list[Child] = []
        self.theirs: list[Any] = []

    def spawn(self, *_: Any, **__: Any) -> Child:
        """In place of the function of processes."""
        if self.refused:
            self.refused -= 1
            raise BlockingIOError(11, "Resource temporarily unavailable")
        channel, theirs = Channel.pair()
        self.theirs.append(theirs)
        self.children.append(Child(Ended(), channel))  # type: ignore[arg-type]
        return self.children[-1]

    def close(self) -> None:
        """Give the sockets back."""
        for child, line in zip(self.children, self.theirs, strict=True):
            child.channel.close()
            line.close()
        self.supervisor._selector.close()


@pytest.fixture
def scripted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Scripted]:
    script = Scripted(tmp_path)
    monkeypatch.setattr(supervisor_module, "spawn", script.spawn)
    monkeypatch.setattr(watch_module, "spawn", script.spawn)
    yield script
    script.close()


def test_a_spare_that_speaks_while_it_is_drained_is_not_heard(scripted: Scripted) -> None:
    supervisor = scripted.supervisor
    supervisor._spare = supervisor._next_spare()
    lifeline, holder = os.pipe()
    supervisor._listen(lifeline, supervisor._lifeline_ended)
    os.close(holder)
    scripted.theirs[0].send(msgpack.packb({"event": "warm"}))
    supervisor._hear()
    assert supervisor._spare is None
    os.close(lifeline)


def test_a_spare_that_the_system_refused_is_started_later(scripted: Scripted) -> None:
    supervisor = scripted.supervisor
    scripted.refused = 2
    supervisor._spare = supervisor._next_spare()
    assert supervisor._spare is None
    supervisor._beat(time.monotonic())
    assert supervisor._spare is None
    supervisor._beat(time.monotonic())
    assert supervisor._spare is scripted.children[0]
    supervisor._beat(time.monotonic())
    assert len(scripted.children) == 1


def test_the_end_of_a_spare_that_was_replaced_starts_no_third(scripted: Scripted) -> None:
    supervisor = scripted.supervisor
    supervisor._spare = first = supervisor._next_spare()
    assert first is not None
    supervisor._spare = second = supervisor._next_spare()
    supervisor._worker_ended(first, spare=True)
    assert supervisor._spare is second
    assert len(scripted.children) == 2


def test_a_monitor_that_the_system_refuses_ends_nothing(scripted: Scripted) -> None:
    supervisor = scripted.supervisor
    monitor = supervisor._watch.monitor = scripted.spawn()
    supervisor._listen(monitor.channel, supervisor._monitor_ended)
    scripted.refused = 1
    supervisor._monitor_ended(monitor.channel)
    assert supervisor._watch.monitor is None
