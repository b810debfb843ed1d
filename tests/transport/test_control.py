"""Control requests with workers that are scripted: which words of a worker outlive it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from mesh_motion_protocol.codec import decode, encode
from mesh_motion_protocol.messages import Open, Opened, Probe, Probed, Resume

from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.control import Control
from mesh_motion_server.transport.protection import Protection
from mesh_motion_server.transport.registry import Registry

CLIENT = bytes(16)


class Scripted:
    """A control whose workers do nothing, and what it answered."""

    def __init__(self, folder: Path) -> None:
        self.replies: list[Any] = []
        self.refusal: OSError | None = None
        settings = ServerSettings.from_mapping({"state_folder": str(folder)})
        registry = Registry(SessionStore(folder))
        self.control = Control(registry, settings, self.start, self.take, Protection.access(None))

    def start(self, order: dict[str, Any]) -> Any:
        if self.refusal is not None:
            raise self.refusal
        return SimpleNamespace(pid=1, channel=SimpleNamespace(send=lambda order: None), kill=lambda: None)

    def take(self, peer: bytes, frame: bytes) -> None:
        self.replies.append(decode([frame]))

    def ask(self, request: Any) -> None:
        self.control.request(b"peer", "", bytes(encode(request)[0]))

    def serving(self, epoch: int) -> None:
        """The newest worker serves."""
        (live,) = self.control.registry.live.values()
        self.control.heard(live, {"event": "serving", "endpoint": "", "epoch": epoch, "state": "READY", "step": 1})


def test_a_worker_that_ended_as_it_should_says_nothing_of_the_next_one(tmp_path: Path) -> None:
    """The lease ends just when RESUME asks for the session: another worker takes over, and later it is killed."""
    told = Scripted(tmp_path)
    told.ask(Open(client=CLIENT, sequence=1, dimension=2, settings={}))
    told.serving(1)
    (opened,) = told.replies
    assert isinstance(opened, Opened)
    (live,) = told.control.registry.live.values()
    told.ask(Resume(client=CLIENT, sequence=2, session=opened.session, token=opened.token))
    told.control.heard(live, {"event": "over"})
    told.control.gone(live, 0)
    told.serving(2)
    told.control.gone(live, -9)
    told.ask(Probe(client=CLIENT, sequence=3, session=opened.session, token=opened.token))
    assert isinstance(told.replies[-1], Probed)
    assert told.replies[-1].worker == "dead"


def test_a_process_that_the_system_refuses_is_an_answer_and_a_repeat_a_new_try(tmp_path: Path) -> None:
    told = Scripted(tmp_path)
    opening = Open(client=CLIENT, sequence=1, dimension=2, settings={})
    told.refusal = BlockingIOError(11, "Resource temporarily unavailable")
    told.ask(opening)
    assert (told.replies[-1].code, told.replies[-1].retryable) == ("RESOURCE_EXHAUSTED", True)
    assert not told.control.registry.live
    told.refusal = None
    told.ask(opening)
    told.serving(1)
    opened = told.replies[-1]
    assert isinstance(opened, Opened)
    (live,) = told.control.registry.live.values()
    told.refusal = OSError(12, "Cannot allocate memory")
    told.ask(Resume(client=CLIENT, sequence=2, session=opened.session, token=opened.token))
    told.control.gone(live, -9)  # while it should take the new holder
    assert told.replies[-1].code == "RESOURCE_EXHAUSTED"
    assert (live.status, live.reclaiming) == ("dead", False)
    told.ask(Resume(client=CLIENT, sequence=3, session=opened.session, token=opened.token))
    assert (told.replies[-1].code, live.status) == ("RESOURCE_EXHAUSTED", "dead")
    told.refusal = None
    told.ask(Resume(client=CLIENT, sequence=4, session=opened.session, token=opened.token))
    told.serving(2)
    assert told.replies[-1].epoch == 2


def test_a_socket_file_that_cannot_be_removed_ends_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told = Scripted(tmp_path)
    told.ask(Open(client=CLIENT, sequence=1, dimension=2, settings={}))
    told.serving(1)
    (live,) = told.control.registry.live.values()
    live.endpoint = f"ipc://{tmp_path}/w1.ipc"

    def refuse(*_: Any, **__: Any) -> None:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(Path, "unlink", refuse)
    told.control.gone(live, -9)
    assert live.status == "dead"


def test_a_worker_that_writes_for_a_new_holder_is_given_the_time_of_a_drain(tmp_path: Path) -> None:
    """What it writes may have been answered: killing it would lose commits of level "relaxed"."""
    told = Scripted(tmp_path)
    told.ask(Open(client=CLIENT, sequence=1, dimension=2, settings={}))
    told.serving(1)
    (live,) = told.control.registry.live.values()
    told.control.heard(live, {"event": "reclaiming"})
    assert live.deadline is None
    told.ask(Resume(client=CLIENT, sequence=2, session=live.session, token=live.token))
    assert live.deadline is not None
    computing = live.deadline
    told.control.heard(live, {"event": "reclaiming"})
    assert live.deadline > computing + 20
