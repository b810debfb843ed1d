"""Control requests with scripted workers: messages of a worker stay valid after its end."""

import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from mesh_motion_protocol.codec import decode, encode
from mesh_motion_protocol.messages import List, Open, Opened, Probe, Probed, Resume
from raising import raising

from mesh_motion_server.operation.disk_watch import DiskWatch
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport import registry as registry_module
from mesh_motion_server.transport.control import Control
from mesh_motion_server.transport.protection import Protection
from mesh_motion_server.transport.registry import Registry

CLIENT = bytes(16)


class Scripted:
    """A control whose workers do nothing, and its answers."""

    def __init__(self, folder: Path) -> None:
        self.replies: list[Any] = []
        self.refusal: OSError | None = None
        self.started = 0
        self.disk = DiskWatch(folder)
        settings = ServerSettings.from_mapping({"state_folder": str(folder)})
        registry = Registry(SessionStore(folder))
        self.control = Control(registry, settings, self.start, self.take, Protection.access(None), self.disk)

    def start(self, order: dict[str, Any]) -> Any:
        if self.refusal is not None:
            raise self.refusal
        self.started += 1
        return SimpleNamespace(pid=1, channel=SimpleNamespace(offer=lambda order: None), kill=lambda: None)

    def take(self, peer: bytes, frame: bytes) -> None:
        self.replies.append(decode([frame]))

    def ask(self, request: Any) -> None:
        self.control.request(b"peer", "", bytes(encode(request)[0]))

    def serving(self, epoch: int) -> None:
        (live,) = self.control.registry.live.values()
        self.control.reported(live, {"event": "serving", "endpoint": "", "epoch": epoch, "state": "READY", "step": 1})


def served(folder: Path) -> tuple[Scripted, Any]:
    """A session was opened; its worker serves."""
    scripted = Scripted(folder)
    scripted.ask(Open(client=CLIENT, sequence=1, dimension=2, settings={}))
    scripted.serving(1)
    (live,) = scripted.control.registry.live.values()
    return scripted, live


@pytest.mark.parametrize("is_stored", [True, False])
def test_a_worker_that_ended_as_it_should_says_nothing_of_the_next_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_stored: bool
) -> None:
    """The session ends at the moment of RESUMEs for it: another worker resumes it if it is stored, and ends later."""
    scripted, live = served(tmp_path)
    (opened,) = scripted.replies
    assert isinstance(opened, Opened)
    for sequence in (2, 3):
        scripted.ask(Resume(client=CLIENT, sequence=sequence, session=opened.session, token=opened.token))
    scripted.control.reported(live, {"event": "over"})
    if is_stored:
        monkeypatch.setattr(SessionStore, "check_token", lambda *_: SimpleNamespace(owner="", label=""))
        monkeypatch.setattr(scripted.control.registry, "owner", lambda _: "")
    scripted.control.gone(live, 0)
    if not is_stored:
        assert (scripted.started, scripted.control.registry.live) == (1, {})
        scripted.control.keep_time(time.monotonic() + 60)
        assert [reply.code for reply in scripted.replies[1:]] == ["NOT_FOUND"] * 2
        return
    (taken_up,) = scripted.control.registry.live.values()
    assert (scripted.started, taken_up.asked is not None, len(taken_up.queue)) == (2, True, 1)
    scripted.serving(2)
    scripted.serving(3)
    assert [reply.epoch for reply in scripted.replies] == [1, 2, 3]
    scripted.control.gone(taken_up, -9)
    scripted.ask(Probe(client=CLIENT, sequence=4, session=opened.session, token=opened.token))
    assert isinstance(scripted.replies[-1], Probed)
    assert scripted.replies[-1].worker == "dead"


def test_a_process_that_the_system_refuses_is_an_answer_and_a_repeat_a_new_try(tmp_path: Path) -> None:
    scripted = Scripted(tmp_path)
    opening = Open(client=CLIENT, sequence=1, dimension=2, settings={})
    scripted.refusal = BlockingIOError(11, "Resource temporarily unavailable")
    scripted.ask(opening)
    assert (scripted.replies[-1].code, scripted.replies[-1].retryable) == ("RESOURCE_EXHAUSTED", True)
    assert not scripted.control.registry.live
    scripted.refusal = None
    scripted.ask(opening)
    scripted.serving(1)
    opened = scripted.replies[-1]
    assert isinstance(opened, Opened)
    (live,) = scripted.control.registry.live.values()
    scripted.refusal = OSError(12, "Cannot allocate memory")
    scripted.ask(Resume(client=CLIENT, sequence=2, session=opened.session, token=opened.token))
    scripted.control.gone(live, -9)  # while it should take the new holder
    assert scripted.replies[-1].code == "RESOURCE_EXHAUSTED"
    assert (live.status, live.reclaiming) == ("dead", False)
    scripted.ask(Resume(client=CLIENT, sequence=3, session=opened.session, token=opened.token))
    assert (scripted.replies[-1].code, live.status) == ("RESOURCE_EXHAUSTED", "dead")
    scripted.refusal = None
    scripted.ask(Resume(client=CLIENT, sequence=4, session=opened.session, token=opened.token))
    scripted.serving(2)
    assert scripted.replies[-1].epoch == 2


def test_a_socket_file_that_cannot_be_removed_ends_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scripted, live = served(tmp_path)
    live.endpoint = f"ipc://{tmp_path}/w1.ipc"
    monkeypatch.setattr(Path, "unlink", raising(OSError(30, "Read-only file system")))
    scripted.control.gone(live, -9)
    assert live.status == "dead"


def test_a_worker_that_writes_for_a_new_holder_is_given_the_time_of_a_drain(tmp_path: Path) -> None:
    """Its unwritten steps may have been answered: a kill would lose commits of level "relaxed"."""
    scripted, live = served(tmp_path)
    scripted.control.reported(live, {"event": "reclaiming"})
    assert live.deadline is None
    scripted.ask(Resume(client=CLIENT, sequence=2, session=live.session, token=live.token))
    assert live.deadline is not None
    computing = live.deadline
    scripted.control.reported(live, {"event": "reclaiming"})
    assert live.deadline > computing + 20


def test_resumes_that_wait_for_one_session_have_a_limit(tmp_path: Path) -> None:
    scripted, live = served(tmp_path)
    for number in range(100):
        scripted.ask(Resume(client=CLIENT, sequence=2 + number, session=live.session, token=live.token))
    refused = scripted.replies[1:]
    assert {(reply.code, reply.retryable) for reply in refused} == {("UNAVAILABLE", True)}
    assert len(live.queue) == 99 - len(refused) == 32
    scripted.ask(Resume(client=CLIENT, sequence=101, session=live.session, token=live.token))
    assert scripted.replies[-1].code == "UNAVAILABLE"  # a repeat is a new try
    scripted.serving(2)
    scripted.ask(Resume(client=CLIENT, sequence=101, session=live.session, token=live.token))
    assert len(live.queue) == 32
    assert scripted.replies[-1].type == "RESUMED"


def test_of_sessions_whose_worker_fell_only_the_latest_are_remembered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry_module, "_FALLEN", 3)
    scripted = Scripted(tmp_path)
    opened = []
    for number in range(6):
        scripted.ask(Open(client=CLIENT, sequence=number + 1, dimension=2, settings={}))
        live = list(scripted.control.registry.live.values())[-1]
        opened.append(live)
        scripted.control.reported(live, {"event": "serving", "endpoint": "", "epoch": 1, "state": "NEW", "step": 0})
        if number:
            scripted.control.gone(live, -9)
    kept = [opened[number].session for number in (0, 3, 4, 5)]
    assert list(scripted.control.registry.live) == kept


def test_a_disk_that_hangs_holds_up_no_request_and_reveals_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scripted, live = served(tmp_path)
    monkeypatch.setattr(scripted.disk, "silence", lambda: 100.0)
    monkeypatch.setattr(scripted.disk, "_answered", threading.Event())
    monkeypatch.setattr(scripted.disk, "ask", lambda: None)
    monkeypatch.setattr(scripted.control.registry, "_store", None)  # asking it would hang
    scripted.ask(Probe(client=CLIENT, sequence=2, session=live.session, token=live.token))
    assert scripted.replies[-1].worker == "alive"
    refused = [
        Open(client=CLIENT, sequence=3, dimension=2, settings={}),
        List(client=CLIENT, sequence=4),
        Probe(client=CLIENT, sequence=5, session="1" * 32, token=live.token),
        Probe(client=CLIENT, sequence=6, session=live.session, token=bytes(32)),
        Resume(client=CLIENT, sequence=7, session="1" * 32, token=live.token),
    ]
    for request in refused:
        scripted.ask(request)
    answers = {(reply.code, reply.message) for reply in scripted.replies[-len(refused) :]}
    assert answers == {("RESOURCE_EXHAUSTED.DISK", "the disk of the state folder does not answer")}


def test_a_worker_that_computes_steps_again_is_not_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scripted = Scripted(tmp_path)
    scripted.ask(Open(client=CLIENT, sequence=1, dimension=2, settings={}))
    (live,) = scripted.control.registry.live.values()
    killed: list[float] = []
    monkeypatch.setattr(live.child, "kill", lambda: killed.append(1.0))
    began = time.monotonic()
    for step in range(1, 10):
        monkeypatch.setattr(time, "monotonic", lambda step=step: began + 500 * step)
        scripted.control.keep_time(time.monotonic())
        scripted.control.reported(live, {"event": "recomputed", "step": step})
    assert not killed
    scripted.serving(2)
    assert live.deadline is None
    scripted.control.reported(live, {"event": "recomputed", "step": 10})  # said before it served, received after
    assert live.deadline is None
