"""The supervisor's loop with scripted children: faults that it survives."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgpack
import pytest
from ended_process import EndedChild

from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport import attendant as attendant_module
from mesh_motion_server.transport import processes
from mesh_motion_server.transport import supervisor as supervisor_module
from mesh_motion_server.transport.channel import Channel
from mesh_motion_server.transport.processes import Child
from mesh_motion_server.transport.registry import Live
from mesh_motion_server.transport.supervisor import Supervisor


def killed(child: Child) -> int:
    assert isinstance(child, EndedChild)
    return child.killed


class Scripted:
    """A supervisor whose children are lines without a process; ``refused``: number of starts that the system
    refuses.
    """

    def __init__(self, folder: Path) -> None:
        settings = ServerSettings.from_mapping({"state_folder": str(folder), "metrics": "127.0.0.1:0"})
        self.supervisor = Supervisor(settings, "error")
        self.refused = 0
        self.children: list[Child] = []
        self.theirs: list[Any] = []

    def spawn(self, *_: Any, **__: Any) -> Child:
        if self.refused:
            self.refused -= 1
            raise BlockingIOError(11, "Resource temporarily unavailable")
        channel, theirs = Channel.pair()
        self.theirs.append(theirs)
        self.children.append(EndedChild(channel))
        return self.children[-1]

    def close(self) -> None:
        for child, line in zip(self.children, self.theirs, strict=True):
            child.channel.close()
            line.close()
        self.supervisor._selector.close()


@pytest.fixture
def scripted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Scripted]:
    script = Scripted(tmp_path)
    monkeypatch.setattr(supervisor_module, "spawn", script.spawn)
    monkeypatch.setattr(attendant_module, "spawn", script.spawn)
    yield script
    script.close()


def test_a_template_ends_after_the_sessions(scripted: Scripted) -> None:
    """Sessions that wait for its fork can still be drained."""
    supervisor = scripted.supervisor
    supervisor._template = supervisor._next_template()
    lifeline, holder = os.pipe()
    supervisor._listen(lifeline, supervisor._lifeline_ended)
    os.close(holder)
    scripted.theirs[0].send(msgpack.packb({"event": "warm"}))
    supervisor._receive()
    assert supervisor._control.draining
    assert killed(scripted.children[0]) == 0
    supervisor.stop()
    assert killed(scripted.children[0]) == 1
    os.close(lifeline)


def test_a_worker_whose_template_is_gone_reads_as_ended(scripted: Scripted) -> None:
    supervisor = scripted.supervisor
    supervisor._template = supervisor._next_template()
    scripted.theirs[0].close()
    child = supervisor._start_session({"order": "create"})
    assert child.channel.receive(30.0) is None
    assert (child.pid, child.reap()) == (0, 1)
    supervisor._selector.unregister(child.channel)


def test_a_template_that_the_system_refused_is_started_later(scripted: Scripted) -> None:
    supervisor = scripted.supervisor
    supervisor._watch.metrics.address = ""  # no monitor
    scripted.refused = 2
    supervisor._template = supervisor._next_template()
    assert supervisor._template is None
    supervisor._beat(time.monotonic())
    assert supervisor._template is None
    supervisor._beat(time.monotonic())
    assert supervisor._template is scripted.children[0]
    supervisor._beat(time.monotonic())
    assert len(scripted.children) == 1


def test_the_end_of_a_template_that_was_replaced_starts_no_third(scripted: Scripted) -> None:
    supervisor = scripted.supervisor
    supervisor._template = first = supervisor._next_template()
    assert first is not None
    supervisor._template = second = supervisor._next_template()
    supervisor._worker_ended(first, template=True)
    assert supervisor._template is second
    assert len(scripted.children) == 2


def test_a_monitor_that_the_system_refuses_ends_nothing(scripted: Scripted) -> None:
    supervisor = scripted.supervisor
    watched = supervisor._watch.metrics
    watched.child = scripted.spawn()
    supervisor._listen(watched.child.channel, lambda _: supervisor._attendant_spoke(watched))
    scripted.refused = 1
    scripted.theirs[0].close()
    supervisor._receive()
    assert watched.child is None
    supervisor._template = supervisor._next_template()
    supervisor._beat(time.monotonic())
    assert watched.child is scripted.children[-1]


@pytest.mark.parametrize(
    "nonsense", [{}, [], {"event": "bound"}, {"event": "bound", "address": 7}, {"event": "unbound"}]
)
def test_a_monitor_that_talks_nonsense_is_ended_and_no_other_process(scripted: Scripted, nonsense: Any) -> None:
    supervisor = scripted.supervisor
    watched = supervisor._watch.metrics
    supervisor._attend(watched)
    scripted.theirs[0].send(msgpack.packb(nonsense))
    supervisor._receive()
    assert watched.child is scripted.children[1]


def test_the_page_knows_the_working_sessions_however_many_fell(
    scripted: Scripted, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mesh_motion_server.transport.watch._MOST_SESSIONS", 3)
    supervisor = scripted.supervisor
    supervisor._template = supervisor._next_template()
    page = supervisor._watch.page.child = scripted.spawn()
    page.spoke = True
    live = supervisor._control.registry.live
    for number, status in enumerate(["alive", "dead", "dead", "starting", "dead", "dead"]):
        live[str(number)] = Live(str(number), b"", "", scripted.children[0], status=status)
    supervisor._watch.beat(supervisor._control.registry, supervisor._gateway, supervisor._template, draining=False)
    live.clear()
    sent = msgpack.unpackb(scripted.theirs[-1].recv(1 << 16))
    assert {entry[0] for entry in sent["sessions"]} == {"0", "3", "5"}


def test_a_monitor_that_hangs_while_it_starts_again_holds_no_request_up(scripted: Scripted) -> None:
    supervisor = scripted.supervisor
    supervisor._template = supervisor._next_template()
    watched = supervisor._watch.metrics
    supervisor._attend(watched)
    hung, now = scripted.children[-1], time.monotonic()
    supervisor._beat(now + 1)
    assert killed(hung) == 0
    watched._due = now
    supervisor._beat(now)
    assert killed(hung) == 1
    scripted.theirs[-1].close()
    supervisor._receive()
    another = scripted.children[-1]
    assert watched.child is another is not hung
    scripted.theirs[-1].send(msgpack.packb({"event": "bound", "address": "127.0.0.1:9"}))
    supervisor._receive()
    watched._due = now
    supervisor._beat(now)
    assert (watched.address, killed(another)) == ("tcp://127.0.0.1:9", 0)


def test_a_process_that_not_even_sigkill_ends_is_left_to_the_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    """It waits for a disk that does not answer; the supervisor does not."""
    monkeypatch.setattr(processes, "_END_SECONDS", 0.01)
    monkeypatch.setattr(os, "waitpid", lambda _pid, _flags: (0, 0))
    kills: list[int] = []
    monkeypatch.setattr(os, "kill", lambda _pid, number: kills.append(number))
    channel, line = Channel.pair()
    assert Child(2**22, channel).reap() == -signal.SIGKILL
    line.close()
    assert kills == [signal.SIGKILL]
