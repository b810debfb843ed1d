"""The gateway from the supervisor's view, with scripted gateways: none of their actions stops the loop."""

import selectors
import time
from collections.abc import Iterator
from typing import Any

import pytest
from ended_process import EndedChild

from mesh_motion_server.transport import gateway_line as module
from mesh_motion_server.transport.channel import Channel
from mesh_motion_server.transport.endpoints import EndpointError
from mesh_motion_server.transport.gateway_line import GatewayLine
from mesh_motion_server.transport.processes import Child
from mesh_motion_server.transport.self_test import ProtectionError


class Script:
    def __init__(self) -> None:
        self.selector = selectors.DefaultSelector()
        self.words: list[dict[str, Any] | None] = []
        self.refusal: OSError | None = None
        self.children: list[Child] = []
        self.theirs: list[Channel] = []
        self.requests: list[tuple[bytes, str, bytes]] = []
        self.line = GatewayLine(self.selector, "tcp://127.0.0.1:0", self.launch, self.take)

    def take(self, peer: bytes, user: str, frame: bytes) -> None:
        self.requests.append((peer, user, frame))

    def launch(self, endpoint: str) -> Child:
        if self.refusal is not None:
            raise self.refusal
        channel, line = Channel.pair()
        self.theirs.append(Channel(line))
        self.children.append(EndedChild(channel))
        word = self.words.pop(0) if self.words else None
        if word is not None:
            self.theirs[-1].send({"endpoint": endpoint.replace(":0", ":7")} | word)
        return self.children[-1]

    def turn(self) -> None:
        """One pass of the supervisor's loop, without waiting."""
        for key, _ in self.selector.select(0):
            key.data(key.fileobj)
        self.line.keep_time(time.monotonic())

    def close(self) -> None:
        for child, line in zip(self.children, self.theirs, strict=True):
            child.channel.close()
            line.close()
        self.selector.close()


BOUND = {"event": "bound"}


@pytest.fixture
def script() -> Iterator[Script]:
    script = Script()
    yield script
    script.close()


@pytest.fixture
def started(script: Script) -> Script:
    script.words = [BOUND]
    script.line.start()
    assert script.line.endpoint == "tcp://127.0.0.1:7"
    return script


def test_a_gateway_that_does_not_read_holds_no_request_up_and_gets_what_was_kept(started: Script) -> None:
    (theirs,) = started.theirs
    frame = bytes(60_000)
    for number in range(1000):
        started.line.reply(number.to_bytes(2, "big"), frame)
    taken = []
    for _ in range(2000):
        started.turn()
        if (message := theirs.receive(0.0)) is not None:
            taken.append(int.from_bytes(message["peer"], "big"))
    assert taken == list(range(len(taken)))
    assert module._KEPT_REPLIES <= len(taken) < 300
    started.line.reply(b"pp", frame)
    assert theirs.receive(0.0) == {"peer": b"pp", "frame": frame}


def test_a_gateway_is_asked_again_when_its_word_was_lost(started: Script) -> None:
    (theirs,) = started.theirs
    for now, asked in ((0.0, True), (5.0, False), (31.0, True)):
        started.line.ask(now, 30.0)
        assert (theirs.receive(0.0) == {"order": "ping"}) is asked
    before = started.line.answered_at
    theirs.send({"event": "pong", "tally": None})
    started.turn()
    assert started.line.answered_at > before
    started.line.ask(32.0, 30.0)
    assert theirs.receive(0.0) == {"order": "ping"}


def test_a_gateway_that_hangs_at_its_restart_is_killed_and_replaced(started: Script) -> None:
    started.theirs[0].close()
    began = time.monotonic()
    started.turn()
    started.line.keep_time(began + 2 * module._PAUSE)
    assert len(started.children) == 2  # which says nothing
    started.line.reply(b"p", b"r")
    started.line.keep_time(time.monotonic() + module._START_SECONDS + 1)
    assert time.monotonic() - began < module._START_SECONDS / 2
    hung = started.children[1]
    assert isinstance(hung, EndedChild)
    assert hung.killed == 1
    started.theirs[1].close()
    started.words = [BOUND]
    started.turn()
    started.line.keep_time(time.monotonic() + 4 * module._PAUSE)
    started.turn()
    started.theirs[2].send({"peer": b"p", "user": "", "frame": b"f"})
    started.turn()
    assert started.requests == [(b"p", "", b"f")]
    assert not started.line.lost


def test_a_gateway_that_repeatedly_cannot_start_is_lost(started: Script) -> None:
    started.refusal = BlockingIOError(11, "Resource temporarily unavailable")
    started.theirs[0].close()
    started.turn()
    now, tries = time.monotonic(), 0
    while not started.line.lost:
        due = started.line.next_deadline()
        assert due is not None
        assert now < due <= now + module._LONGEST_PAUSE
        now, tries = due, tries + 1
        started.line.keep_time(now)
    assert tries == module._STARTS


def test_a_gateway_that_repeatedly_crashes_after_its_start_is_not_lost(started: Script) -> None:
    """The sessions continue; pauses between the failures keep a processor free."""
    now, pauses = time.monotonic(), []
    for _ in range(2 * module._STARTS):
        started.theirs[-1].close()
        started.turn()
        pauses.append(started.line._due - time.monotonic())
        started.words = [BOUND]
        started.line.keep_time(now + module._LONGEST_PAUSE + 1)
        started.turn()
    assert not started.line.lost
    assert module._PAUSE / 2 < pauses[0] <= module._PAUSE
    assert module._LONGEST_PAUSE / 2 < pauses[-1] <= module._LONGEST_PAUSE


@pytest.mark.parametrize(
    ("word", "error"),
    [
        ({"event": "unbound", "reason": "taken", "unprotected": False}, EndpointError),
        ({"event": "unbound", "reason": "open", "unprotected": True}, ProtectionError),
        (None, EndpointError),
    ],
)
def test_the_first_start_fails_in_finite_time(
    script: Script, word: Any, error: type[Exception], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_START_SECONDS", 0.1)
    script.words = [word]
    with pytest.raises(error, match="cannot listen on" if error is EndpointError else "open"):
        script.line.start()
