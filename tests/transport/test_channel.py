"""The line between the supervisor and its children: neither end waits for an end that does not read."""

import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from mesh_motion_protocol.codec import decode, encode
from mesh_motion_protocol.errors import InvalidInput
from mesh_motion_protocol.messages import List, Ping

from mesh_motion_server.transport import channel as channel_module
from mesh_motion_server.transport.channel import Channel, Outbox
from mesh_motion_server.transport.gateway import Gateway
from mesh_motion_server.transport.processes import Attempts
from mesh_motion_server.transport.template import _failure

Ends = tuple[Channel, Channel]


@pytest.fixture
def ends(monkeypatch: pytest.MonkeyPatch) -> Iterator[Ends]:
    monkeypatch.setattr(channel_module, "_SEND_SECONDS", 1)
    here, line = Channel.pair()
    there = Channel(line)
    yield here, there
    here.close()
    there.close()


def fill(end: Channel) -> int:
    count = 0
    while end.offer({"number": count}):
        count += 1
    return count


def test_a_message_to_an_end_that_does_not_read_is_given_up(ends: Ends) -> None:
    here, there = ends
    count = fill(here)
    began = time.monotonic()
    assert not here.send({"number": count})
    assert time.monotonic() - began > 0.5
    assert [there.receive() for _ in range(count)] == [{"number": number} for number in range(count)]
    assert here.send({"number": count})


def test_a_wait_for_a_word_has_a_limit(ends: Ends) -> None:
    here, there = ends
    assert here.receive(0.01) is None
    there.send({"word": 1})
    assert here.receive(0.01) == {"word": 1}
    there.close()
    assert here.receive(0.01) is None


def test_an_outbox_keeps_the_order_and_so_many_at_most(ends: Ends) -> None:
    here, there = ends
    outbox = Outbox(here, 3)
    sent = fill(here)
    assert [outbox.put({"number": sent + extra}) for extra in range(5)] == [True] * 3 + [False] * 2
    outbox.flush()
    assert len(outbox) == 3
    assert there.receive() == {"number": 0}
    while len(outbox):
        outbox.flush()
        there.receive(0.0)
    numbers = []
    while (message := there.receive(0.0)) is not None:
        numbers.append(message["number"])
    assert numbers[-3:] == [sent, sent + 1, sent + 2]
    assert outbox.put({"number": -1})
    assert there.receive() == {"number": -1}


def test_a_gateway_answers_while_the_supervisor_does_not_read(ends: Ends) -> None:
    (here, there), sent = ends, list[Any]()
    socket = SimpleNamespace(send_multipart=lambda frames, **_: sent.append(decode(frames[1:])))
    gateway = Gateway(there, socket, {})  # type: ignore[arg-type]
    number = 0
    while not sent:
        number += 1
        gateway._take(b"peer", "", [bytes(f) for f in encode(List(client=bytes(16), sequence=number))])
    refused = sent.pop()
    assert (refused.code, refused.retryable, refused.sequence) == ("UNAVAILABLE", True, number)
    gateway._obey({"order": "ping"})  # the report that its loop turns cannot be sent
    gateway._take(b"peer", "", [bytes(f) for f in encode(Ping(client=bytes(16), sequence=1))])
    assert sent.pop().type == "PONG"
    assert [here.receive(0.0) is not None for _ in range(number)] == [True] * (number - 1) + [False]
    gateway._obey({"order": "ping"})
    pong = here.receive(0.0)
    assert [entry for entry in pong["tally"]["counts"] if entry[:2] == ["refused", "UNAVAILABLE"]]


def test_attempts_are_so_many_an_hour() -> None:
    attempts = Attempts(2)
    attempts.note(0.0)
    assert not attempts.over(1.0)
    attempts.note(1000.0)
    assert attempts.over(1000.0)
    assert attempts.over(3599.0)
    assert not attempts.over(3601.0)
    attempts.note(3601.0)
    assert attempts.over(3602.0)
    assert not attempts.over(4601.0)


def test_an_end_that_talks_nonsense_is_as_good_as_gone() -> None:
    here, line = Channel.pair()
    for nonsense in (b"\xc1", b"\xa5abc", bytes([0x82]), b"\x80\x80"):
        line.send(nonsense)
        assert here.receive(30.0) is None
    line.close()
    here.close()


def test_a_failure_fits_a_message_however_much_it_says() -> None:
    here, line = Channel.pair()
    there = Channel(line)
    for error in (
        ZeroDivisionError("x" * 300_000),
        InvalidInput("y" * 300_000, details={"nodes": list(range(100_000))}),
    ):
        assert there.send({"event": "failed"} | _failure(error))
        received = here.receive(30.0)
        assert len(received["message"]) < 10_000
        assert received["details"] == {}
    there.close()
    here.close()
