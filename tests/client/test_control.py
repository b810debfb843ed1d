"""Addresses of the data endpoints for a client, and requests that keep their ids."""

import contextlib

import pytest
from mesh_motion_client import SessionError, Timeout, control
from mesh_motion_client.connection import ConnectionLost, DamagedReply
from mesh_motion_client.control import Control
from mesh_motion_protocol.messages import Open, Opened


@pytest.mark.parametrize(
    ("control", "given", "reached"),
    [
        ("tcp://server:7440", "tcp://0.0.0.0:40001", "tcp://server:40001"),
        ("tcp://[::1]:7440", "tcp://[::]:40001", "tcp://[::1]:40001"),
        ("tcp://127.0.0.1:7440", "tcp://127.0.0.1:40001", "tcp://127.0.0.1:40001"),
        ("ipc:///run/mm/control", "ipc:///run/mm/w12.ipc", "ipc:///run/mm/w12.ipc"),
    ],
)
def test_a_wildcard_stands_for_the_host_of_the_control_endpoint(control, given, reached):
    assert Control(control).data_endpoint(given) == reached


class Wire:
    """A replacement of a connection: it keeps messages and gives prepared answers."""

    def __init__(self, outcomes):
        self.outcomes, self.sent, self.closed, self.made = list(outcomes), [], False, 0

    def __call__(self, *_):
        self.made += 1
        self.closed = False
        return self

    def request(self, message, _deadline, _watch=None):
        self.sent.append((message.type, message.sequence))
        outcome = self.outcomes.pop(0)
        if isinstance(outcome, Exception):
            raise outcome
        return Opened(client=message.client, sequence=message.sequence, **OPENED)

    def close(self):
        self.closed = True


OPENED = {"session": "0" * 32, "token": b"t" * 32, "endpoint": "tcp://127.0.0.1:1", "epoch": 1}


@pytest.mark.parametrize("failure", [Timeout("silence"), DamagedReply("noise"), ConnectionLost("gone")])
def test_an_open_that_was_not_answered_keeps_its_id(monkeypatch, failure):
    wire = Wire([failure, None, None])
    monkeypatch.setattr(control, "Connection", wire)
    asking = Control("tcp://127.0.0.1:1")
    with pytest.raises(type(failure)):
        asking.ask(Open, Opened, 0.0, dimension=2)
    assert asking.ask(Open, Opened, 0.0, dimension=2).session == "0" * 32
    asking.ask(Open, Opened, 0.0, dimension=2)
    assert wire.sent == [("OPEN", 1), ("OPEN", 1), ("OPEN", 2)]


def test_a_connection_that_kept_silent_is_given_up(monkeypatch):
    wire = Wire([Timeout("silence"), None, None])
    monkeypatch.setattr(control, "Connection", wire)
    asking = Control("tcp://127.0.0.1:1")
    with pytest.raises(Timeout):
        asking.ask(Open, Opened, 0.0, dimension=2)
    assert wire.closed
    for _ in range(2):
        asking.ask(Open, Opened, 0.0, dimension=2)
    assert wire.made == 2


def test_each_request_that_was_not_answered_keeps_its_own_id(monkeypatch):
    """Two sessions are opened at once over one connection, and no answer comes."""
    wire = Wire([Timeout("silence"), ConnectionLost("gone"), SessionError("no"), Timeout("silence"), None, None, None])
    monkeypatch.setattr(control, "Connection", wire)
    asking = Control("tcp://127.0.0.1:1")
    asked = [("wing", Timeout), ("flap", ConnectionLost), ("tail", SessionError), ("flap", Timeout), ("wing", None)]
    for label, error in asked:
        with contextlib.nullcontext() if error is None else pytest.raises(error):
            asking.ask(Open, Opened, 0.0, dimension=2, label=label)
    for label in ("flap", "wing"):
        asking.ask(Open, Opened, 0.0, dimension=2, label=label)
    assert [sequence for _, sequence in wire.sent] == [1, 2, 3, 2, 1, 2, 4]


def test_no_more_ids_are_kept_than_may_be(monkeypatch):
    monkeypatch.setattr(control, "_MOST_UNANSWERED", 2)
    wire = Wire([Timeout("silence")] * 5)
    monkeypatch.setattr(control, "Connection", wire)
    asking = Control("tcp://127.0.0.1:1")
    for label in ("a", "b", "c", "b", "a"):
        with pytest.raises(Timeout):
            asking.ask(Open, Opened, 0.0, dimension=2, label=label)
    assert [sequence for _, sequence in wire.sent] == [1, 2, 3, 2, 4]
